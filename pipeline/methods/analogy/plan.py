"""What is done in which order: scan, then a chain of levels and sweeps for each shot.

scan         one pass over the video: its frames, its shots, its tones
synthesise   each shot for itself: from the coarsest level to the finest, forward then backward through time, in
             runs of frames. A task is one run of one sweep: it goes on from what the run before has saved, so that
             a restart repeats at most one run. Frames on their own (temporal = off, stills): runs, no chain
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from pipeline.errors import BadInput
from pipeline.frames import Plane
from pipeline.methods.analogy.interval import Piece, pieces
from pipeline.methods.analogy.keys import key_numbers
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.segmentation.cuts import is_cut, thumbnail
from pipeline.synthesis.tones import Tally, lab_guide

RUN_BYTES = 160 << 20
"""What a run's offsets take at most, at the finest level: it decides how many frames a run has."""
MOST_RUN = 32
_BYTES_A_PIXEL = 11


def plan_scan(brief: Brief) -> list[Task]:
    return [Task("video", weight=0.05 * max(brief.video.frames, 1))]


def run_scan(task: Task, bench: Bench) -> Note:
    """Count the frames, call the cuts, and learn the video's tones."""
    params: AnalogyParams = bench.params
    before: Plane | None = None
    cuts: list[int] = []
    tally, count = Tally(), 0
    for index, frame in enumerate(bench.frames("video")):
        with bench.clock("scan"):
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, params.cut_sensitivity):
                cuts.append(index)
            tally.add(lab_guide(frame))
        before, count = now, index + 1
        bench.progress(min(1.0, count / max(bench.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    bench.save("tones", vars(tally.tones()))
    return {"frames": count, "cuts": cuts, "keys": key_numbers(bench, count)}


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

    def args(self) -> dict[str, Any]:
        return asdict(self)


def run_frames(size: tuple[int, int]) -> int:
    """Frames a run."""
    return max(2, min(MOST_RUN, RUN_BYTES // (size[0] * size[1] * _BYTES_A_PIXEL)))


def plan_synthesis(brief: Brief) -> list[Task]:
    scan = brief.notes["scan"]["video"]
    size = (brief.video.width, brief.video.height)
    edges = [0, *scan["cuts"], scan["frames"]]
    tasks: list[Task] = []
    for begin, end in pairwise(edges):
        keys = [(int(index), bool(full)) for index, full in scan["keys"] if begin <= index < end]
        if keys:
            tasks += [_keyed(key, piece) for key, piece in pieces(begin, end, keys)]
            continue
        alone = brief.params.temporal == "off" or end - begin == 1
        jobs = _alone(begin, end, size) if alone else _chain(brief.params, begin, end, size)
        tasks += [_task(key, job) for key, job in jobs]
    return tasks


def _keyed(key: str, piece: Piece) -> Task:
    frames = piece.last - piece.first
    return Task(key, piece.args(), (piece.task,) if piece.task else (), (piece.first, piece.last), weight=1.3 * frames)


def _task(key: str, job: Job) -> Task:
    frames = job.stop - job.start
    after = tuple(dict.fromkeys(name for name in (job.known, job.neighbour) if name))
    emits = (job.start, job.stop) if job.level < 0 or job.last else None
    cost = 1.0 if job.level < 0 else 0.375 * 0.25**job.level
    return Task(key, job.args(), after, emits, weight=frames * cost)


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
        forward = sweep % 2 == 0
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


def _key(level: int, sweep: int, start: int) -> str:
    return f"level-{level}-{'back' if sweep % 2 else 'forth'}-{sweep // 2}-{start:07d}"
