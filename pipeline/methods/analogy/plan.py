"""What is done in which order: scan, then a chain of levels and sweeps for each shot of each layer, then composite.

scan         one pass over the video and its layers: frames, shots, tones, keys
synthesise   each layer of each shot for itself, and each interval between painted keys. Without keys: from the
             coarsest level to the finest, backward then forward through time, in runs of frames. A task is one run of
             one sweep: it goes on from what the run before has saved, so that a restart repeats at most one run.
             All of a short shot's coarse levels, a sixteenth of its work, are one task
             Frames on their own (temporal = off, stills): runs, no chain
composite    layers over each other, in runs of frames; nothing to do where there are none
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

from pipeline.methods.analogy.interval import Piece, piece_frames, pieces
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import Brief, Note, Task

RUN_BYTES = 160 << 20
"""What a run's offsets take at most, at the finest level: it decides how many frames a run has."""
MOST_RUN = 32
_BYTES_A_PIXEL = 11
_COARSE = 2
"""From this level on a shot of one run has one task for all levels."""


@dataclass(frozen=True)
class Job:
    """A task's work: frames [start, stop) of the shot [begin, end), one sweep at one level (or all, on their own)."""

    begin: int
    end: int
    start: int
    stop: int
    level: int = -1
    """-1: every level, each frame on its own."""
    forward: bool = True
    first: bool = False
    """This sweep is the first of the coarsest level: nothing is known yet."""
    last: bool = False
    """This sweep is the last of the finest level: frames are emitted."""
    known: str = ""
    """Task that has saved what is known of these frames."""
    neighbour: str = ""
    """Task that has saved the neighbouring frame."""
    coarser: bool = False
    """What is known is of the level above."""
    sweep: int = 0
    layer: int = -1

    def args(self) -> dict[str, Any]:
        return asdict(self)


def run_frames(size: tuple[int, int]) -> int:
    """Frames a run."""
    return max(2, min(MOST_RUN, RUN_BYTES // (size[0] * size[1] * _BYTES_A_PIXEL)))


def plan_synthesis(brief: Brief) -> list[Task]:
    scan = brief.notes["scan"]["video"]
    layers = scan["layers"]
    if not layers:
        return _layer(brief, scan, scan["keys"], -1)
    return [task for number, layer in enumerate(layers) for task in _layer(brief, scan, layer["keys"], number)]


def _layer(brief: Brief, scan: Note, painted: list[Any], layer: int) -> list[Task]:
    """The tasks of one layer (-1: the whole picture)."""
    size = (brief.video.width, brief.video.height)
    tasks: list[Task] = []
    for begin, end in pairwise([0, *scan["cuts"], scan["frames"]]):
        keys = [(int(index), bool(full)) for index, full in painted if begin <= index < end]
        if keys:
            tasks += [_keyed(key, piece) for key, piece in pieces(begin, end, keys, piece_frames(size), layer)]
            continue
        alone = brief.params.temporal == "off" or end - begin == 1
        jobs = _alone(begin, end, size) if alone else _chain(brief.params, begin, end, size)
        tasks += [_task(group) for group in _grouped(_of_layer(jobs, layer), end - begin <= run_frames(size))]
    return tasks


def _grouped(jobs: Iterator[tuple[str, Job]], short: bool) -> Iterator[list[tuple[str, Job]]]:
    """What is one task: a job, or all coarse ones of a short shot, since what a task costs the farm does not shrink."""
    coarse: list[tuple[str, Job]] = []
    for key, job in jobs:
        if short and job.level >= _COARSE:
            coarse.append((key, job))
            continue
        if coarse:
            yield coarse
            coarse = []
        yield [(key, job)]
    if coarse:
        yield coarse


def _of_layer(jobs: Iterator[tuple[str, Job]], layer: int) -> Iterator[tuple[str, Job]]:
    prefix = f"layer-{layer}-" if layer >= 0 else ""

    def named(key: str) -> str:
        return prefix + key if key else ""

    for key, job in jobs:
        yield named(key), replace(job, layer=layer, known=named(job.known), neighbour=named(job.neighbour))


def plan_composite(brief: Brief) -> list[Task]:
    """Runs of frames, if there are layers."""
    scan = brief.notes["scan"]["video"]
    step = run_frames((brief.video.width, brief.video.height))
    starts = range(0, scan["frames"], step) if scan["layers"] else ()
    runs = [(start, min(start + step, scan["frames"])) for start in starts]
    return [
        Task(f"frames-{start:07d}", {"layers": len(scan["layers"])}, (), (start, stop), 0.05 * (stop - start))
        for start, stop in runs
    ]


def _keyed(key: str, piece: Piece) -> Task:
    frames = piece.last - piece.first
    emits = (piece.first, piece.last) if piece.layer < 0 else None
    return Task(key, piece.args(), (piece.task,) if piece.task else (), emits, weight=1.3 * frames)


def _task(group: list[tuple[str, Job]]) -> Task:
    """Of jobs that are done one after the other, named after the last."""
    *before, (key, job) = group
    inside = {name for name, _ in before}
    names = (name for _, each in group for name in (each.known, each.neighbour))
    after = tuple(dict.fromkeys(name for name in names if name and name not in inside))
    emits = (job.start, job.stop) if job.layer < 0 and (job.level < 0 or job.last) else None
    args = job.args() | ({"before": [[name, each.args()] for name, each in before]} if before else {})
    return Task(key, args, after, emits, weight=sum(_cost(each) for _, each in group))


def _cost(job: Job) -> float:
    return (job.stop - job.start) * (1.0 if job.level < 0 else 0.375 * 0.25**job.level)


def _alone(begin: int, end: int, size: tuple[int, int]) -> Iterator[tuple[str, Job]]:
    step = run_frames(size)
    for start in range(begin, end, step):
        yield f"frames-{start:07d}", Job(begin, end, start, min(start + step, end))


def _chain(params: AnalogyParams, begin: int, end: int, size: tuple[int, int]) -> Iterator[tuple[str, Job]]:
    """Every level, every sweep, every run of a shot, each named after the ones it goes on from."""
    step = run_frames(size)
    runs = [(start, min(start + step, end)) for start in range(begin, end, step)]
    sweeps = [(level, sweep) for level in reversed(range(params.levels)) for sweep in range(2 * params.sweeps)]
    before: tuple[int, int] | None = None
    for level, sweep in sweeps:
        forward = forward_in(sweep)
        ordered = runs if forward else runs[::-1]
        for place, (start, stop) in enumerate(ordered):
            yield _key(level, sweep, start), Job(
                begin, end, start, stop, level, forward,
                first=before is None, last=(level, sweep) == sweeps[-1],
                known=_key(*before, start) if before else "",
                neighbour=_key(level, sweep, ordered[place - 1][0]) if place else "",
                coarser=before is not None and before[0] != level, sweep=sweep,
            )  # fmt: skip
        before = (level, sweep)


def forward_in(sweep: int) -> bool:
    """Whether a sweep goes forward through time: the second of each pair.

    Departure: the paper goes forward, then backward. A film shows each frame after the one before it, so that is what
    the last sweep holds on to, along the motion that leads there: optical flow is not quite the same both ways.
    A person signing (300 lines, Delaunay) flickers at 1.55 instead of 1.64.
    """
    return sweep % 2 == 1


def _key(level: int, sweep: int, start: int) -> str:
    return f"level-{level}-{'forth' if forward_in(sweep) else 'back'}-{sweep // 2}-{start:07d}"
