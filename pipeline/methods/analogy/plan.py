"""The plan of a job: scan, synthesise, composite.

scan         one pass over the video and its layers: frame count, cuts, tones, keyframes
synthesise   layers, shots and intervals between keyframes are independent of each other.
             Without keyframes: from the coarsest level to the finest, each level backward and then forward in time,
             in runs of frames. One task is one run of one sweep; it starts from the artefacts of the run before, so a
             restart repeats at most one run. The coarse levels of a short shot (a sixteenth of its work) are one task.
             Independent frames (temporal = off, stills): runs without dependencies
composite    lays the layers over each other, in runs of frames; no tasks without layers
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

from pipeline.methods.analogy.interval import KeyInterval, interval_frames, split_intervals
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import PlanContext, Task, TaskResult

RUN_BYTES = 160 << 20
"""Maximum memory of the offsets of a run at the finest level; it determines the number of frames of a run."""
MOST_RUN = 32
_BYTES_A_PIXEL = 11
_COARSE = 2
"""Levels from this one on are grouped into one task if the shot fits into one run."""


@dataclass(frozen=True)
class SweepTask:
    """Work of a task: one sweep at one level over the frames [start, stop) of the shot [begin, end)."""

    begin: int
    end: int
    start: int
    stop: int
    level: int = -1
    """-1 = all levels, each frame independently."""
    forward: bool = True
    first: bool = False
    """Whether this is the first sweep of the coarsest level, which has no previous result."""
    last: bool = False
    """Whether this is the last sweep of the finest level, which emits the frames."""
    known: str = ""
    """Task that has saved the previous result of these frames."""
    neighbour: str = ""
    """Task that has saved the neighbouring frame in time."""
    coarser: bool = False
    """Whether the previous result is of the next coarser level."""
    sweep: int = 0
    layer: int = -1

    def args(self) -> dict[str, Any]:
        return asdict(self)


def run_frames(size: tuple[int, int]) -> int:
    """Number of frames of a run at a frame size (width, height) px."""
    return max(2, min(MOST_RUN, RUN_BYTES // (size[0] * size[1] * _BYTES_A_PIXEL)))


def _step(params: AnalogyParams, size: tuple[int, int]) -> int:
    """Frames a run; an even number on twos, so that both frames that show a painting are in one run."""
    return run_frames(size) // 2 * 2 if params.on_twos == "on" else run_frames(size)


def plan_synthesis(context: PlanContext[AnalogyParams]) -> list[Task]:
    scan = context.results["scan"]["video"]
    layers = scan["layers"]
    if not layers:
        return _layer(context, scan, scan["keys"], -1)
    return [task for number, layer in enumerate(layers) for task in _layer(context, scan, layer["keys"], number)]


def _layer(context: PlanContext[AnalogyParams], scan: TaskResult, painted: list[Any], layer: int) -> list[Task]:
    """The tasks of one layer (-1 = the whole picture)."""
    size = (context.video.width, context.video.height)
    tasks: list[Task] = []
    for begin, end in pairwise([0, *scan["cuts"], scan["frames"]]):
        keys = [(int(index), bool(full)) for index, full in painted if begin <= index < end]
        if keys:
            tasks += [
                _keyed(key, interval)
                for key, interval in split_intervals(begin, end, keys, interval_frames(size), layer)
            ]
            continue
        alone = context.params.temporal == "off" or end - begin == 1
        jobs = _alone(context.params, begin, end, size) if alone else _chain(context.params, begin, end, size)
        tasks += [_task(group) for group in _grouped(_of_layer(jobs, layer), end - begin <= run_frames(size))]
    return tasks


def _grouped(jobs: Iterator[tuple[str, SweepTask]], short: bool) -> Iterator[list[tuple[str, SweepTask]]]:
    """Group sweeps into tasks: the coarse levels of a short shot are one task, since each task has a fixed overhead."""
    coarse: list[tuple[str, SweepTask]] = []
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


def _of_layer(jobs: Iterator[tuple[str, SweepTask]], layer: int) -> Iterator[tuple[str, SweepTask]]:
    prefix = f"layer-{layer}-" if layer >= 0 else ""

    def named(key: str) -> str:
        return prefix + key if key else ""

    for key, job in jobs:
        yield named(key), replace(job, layer=layer, known=named(job.known), neighbour=named(job.neighbour))


def plan_composite(context: PlanContext[AnalogyParams]) -> list[Task]:
    """Runs of frames; none without layers."""
    scan = context.results["scan"]["video"]
    step = run_frames((context.video.width, context.video.height))
    starts = range(0, scan["frames"], step) if scan["layers"] else ()
    runs = [(start, min(start + step, scan["frames"])) for start in starts]
    return [
        Task(f"frames-{start:07d}", {"layers": len(scan["layers"])}, (), (start, stop), 0.05 * (stop - start))
        for start, stop in runs
    ]


def _keyed(key: str, interval: KeyInterval) -> Task:
    frames = interval.last - interval.first
    emits = (interval.first, interval.last) if interval.layer < 0 else None
    return Task(key, interval.args(), (interval.task,) if interval.task else (), emits, weight=1.3 * frames)


def _task(group: list[tuple[str, SweepTask]]) -> Task:
    """A task that runs sweeps one after the other, named after the last."""
    *before, (key, job) = group
    inside = {name for name, _ in before}
    names = (name for _, each in group for name in (each.known, each.neighbour))
    after = tuple(dict.fromkeys(name for name in names if name and name not in inside))
    emits = (job.start, job.stop) if job.layer < 0 and (job.level < 0 or job.last) else None
    args = job.args() | ({"before": [[name, each.args()] for name, each in before]} if before else {})
    return Task(key, args, after, emits, weight=sum(_cost(each) for _, each in group))


def _cost(job: SweepTask) -> float:
    return (job.stop - job.start) * (1.0 if job.level < 0 else 0.375 * 0.25**job.level)


def _alone(params: AnalogyParams, begin: int, end: int, size: tuple[int, int]) -> Iterator[tuple[str, SweepTask]]:
    step = _step(params, size)
    for start in range(begin, end, step):
        yield f"frames-{start:07d}", SweepTask(begin, end, start, min(start + step, end))


def _chain(params: AnalogyParams, begin: int, end: int, size: tuple[int, int]) -> Iterator[tuple[str, SweepTask]]:
    """All sweeps of a shot, run by run, with the tasks that each depends on."""
    step = _step(params, size)
    runs = [(start, min(start + step, end)) for start in range(begin, end, step)]
    sweeps = [(level, sweep) for level in reversed(range(params.levels)) for sweep in range(2 * params.sweeps)]
    before: tuple[int, int] | None = None
    for level, sweep in sweeps:
        forward = forward_in(sweep)
        ordered = runs if forward else runs[::-1]
        for place, (start, stop) in enumerate(ordered):
            yield _key(level, sweep, start), SweepTask(
                begin, end, start, stop, level, forward,
                first=before is None, last=(level, sweep) == sweeps[-1],
                known=_key(*before, start) if before else "",
                neighbour=_key(level, sweep, ordered[place - 1][0]) if place else "",
                coarser=before is not None and before[0] != level, sweep=sweep,
            )  # fmt: skip
        before = (level, sweep)


def forward_in(sweep: int) -> bool:
    """Whether a sweep goes forward in time: the second of each pair.

    Departure: the paper goes forward, then backward. Here the last sweep is the forward one, because viewers compare
    each
    frame with the frame before it, and optical flow is not symmetric. Measured flicker (a person signing, 300 rows,
    Delaunay): 1.55 instead of 1.64.
    """
    return sweep % 2 == 1


def _key(level: int, sweep: int, start: int) -> str:
    return f"level-{level}-{'forth' if forward_in(sweep) else 'back'}-{sweep // 2}-{start:07d}"
