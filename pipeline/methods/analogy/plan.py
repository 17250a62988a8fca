"""The plan of a job: how the steps scan, synthesise and composite are divided into tasks.

scan         one pass over the video and its layers: frame count, cuts, tones, keyframes
synthesise   layers, shots and intervals between keyframes are independent of each other.
             Without keyframes: from the coarsest level to the finest, each level backward and then forward in time,
             in runs of frames. One task is one run of one sweep; it starts from the artefacts of the run before, so a
             restart repeats at most one run. Runs of coarse levels have more frames, since their offsets take a
             sixteenth of the memory. The coarse levels of a short shot (a fifth of its work) are one task.
             Independent frames (temporal = off, stills): runs without dependencies
composite    composites the layers, in runs of frames; no tasks without layers
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace

from pipeline.methods.analogy.key_intervals import (
    KeyInterval,
    gaps,
    interval_frames,
    interval_key,
    key_limit,
    split_intervals,
)
from pipeline.methods.analogy.key_settings import KeySettings
from pipeline.methods.analogy.level_animation import levels_of
from pipeline.methods.analogy.params import AnalogyParams, overridden
from pipeline.methods.base import PlanContext, Task, TaskResult, VideoInfo
from pipeline.methods.holds import painted_frame
from pipeline.methods.scan import delivered_shots

MAX_RUN_FRAMES = 32
MAX_RUN_BYTES = 160 << 20
"""Maximum memory of the offsets of a run at the finest level; it determines the number of frames of a run."""
_OFFSET_BYTES = 11
"""Memory of the offsets of a frame, bytes per pixel."""
FINE_LEVELS = 3
"""Number of finest levels that one forward sweep refines if `refinement` is fast."""
FAST_FROM_ROWS = 720
"""Rows of the frame from which `refinement=auto` is fast."""
_COARSE_LEVEL = 2
"""Finest level that has long runs. The sweeps of this and coarser levels are one task if the shot fits into one run."""


@dataclass(frozen=True)
class SweepTask:
    """Work of a task: one sweep at one level over the frames [start, stop) of the shot [begin, end).

    Attributes:
        level: level of the pyramid, 0 = finest; -1 = all levels, each frame independently.
        forward: whether the sweep goes forward in time.
        first: whether this is the first sweep of the coarsest level, which has no previous result.
        last: whether this is the last sweep of the finest level, which emits the frames.
        previous: task that has saved the previous result of these frames; "" = none.
        neighbour: task that has saved the neighbouring frame in time; "" = none.
        from_coarser: whether the previous result is of the next coarser level.
        sweep: number of the sweep within its level.
        fine: whether each frame continues the frame before it with few rounds, in the only sweep of its level.
        layer: number of the layer; -1 = the whole picture.
    """

    begin: int
    end: int
    start: int
    stop: int
    level: int = -1
    forward: bool = True
    first: bool = False
    last: bool = False
    previous: str = ""
    neighbour: str = ""
    from_coarser: bool = False
    sweep: int = 0
    fine: bool = False
    layer: int = -1

    def args(self) -> TaskResult:
        """The attributes as JSON values."""
        return asdict(self)


Sweeps = Iterator[tuple[str, SweepTask]]
"""(task key, sweep), in the order in which they depend on each other."""


def run_frames(size: tuple[int, int]) -> int:
    """Number of frames of a run at a frame size (width, height) px."""
    return max(2, min(MAX_RUN_FRAMES, MAX_RUN_BYTES // (size[0] * size[1] * _OFFSET_BYTES)))


def _run_length(params: AnalogyParams, size: tuple[int, int], level: int = 0) -> int:
    """Number of frames of a run at a level; even on twos, so that both frames that show a painting are in one run.

    A run of a coarse level consists of whole runs of the finest level.
    """
    held = params.frames_per_painting
    length = run_frames(size) // held * held
    return length * (MAX_RUN_FRAMES // length) if level >= _COARSE_LEVEL else length


def plan_synthesis(context: PlanContext[AnalogyParams]) -> list[Task]:
    """Tasks of all layers and shots, see the top of this file."""
    scan = context.results["scan"]["video"]
    layers = scan["layers"]
    if not layers:
        return _layer_tasks(context, scan, scan, -1)
    return [
        task
        for number, layer in enumerate(layers)
        if layer["stylised"]
        for task in _layer_tasks(context, scan, layer, number)
    ]


def _layer_tasks(context: PlanContext[AnalogyParams], scan: TaskResult, found: TaskResult, layer: int) -> list[Task]:
    """The tasks of one layer (-1 = the whole picture).

    Args:
        scan: result of the step scan.
        found: what the scan found of the layer: its keyframes, (frame number, whether it is painted everywhere); their
            sources, see `key_sources`; their reach and weight, if these are given; its own parameters.
    """
    params = overridden(context.params, found.get("params", {}))
    size = (context.video.width, context.video.height)
    sources = {int(index): (behind, ahead) for index, behind, ahead in found.get("sources", [])}
    settings = {int(index): KeySettings(**row) for index, row in found.get("settings", [])}
    tasks: list[Task] = []
    video = context.video
    for begin, end in delivered_shots(context, scan):
        keys = [(int(index), bool(full)) for index, full in found["keys"] if begin <= index < end]
        unkeyed = [(begin, end)]
        if keys:
            unit, most = params.frames_per_painting, key_limit(size)
            limited = {index: (behind[:most], ahead[:most]) for index, (behind, ahead) in sources.items()}
            coherent = params.temporal == "on"
            parts = split_intervals(begin, end, keys, interval_frames(size), limited, unit, settings, coherent)
            intervals = {interval_key(part.start, layer): replace(part, layer=layer) for _, part in parts}
            tasks += [_interval_task(key, intervals[key]) for key in _needed(intervals, video, layer)]
            names = [index for index, _ in keys]
            unkeyed = [run for run in gaps(begin, end, names, settings) if video.delivers_any(*run)]
        elif video.is_piece:
            first = painted_frame(max(begin, video.first), begin, params.frames_per_painting)
            unkeyed = [(first, min(end, video.stop))]
        for run in unkeyed:
            tasks += _unkeyed_tasks(params, run, size, layer)
    return tasks


def _unkeyed_tasks(params: AnalogyParams, run: tuple[int, int], size: tuple[int, int], layer: int) -> list[Task]:
    """The tasks of frames [begin, end) that no keyframe reaches."""
    begin, end = run
    independent = params.temporal == "off" or end - begin == 1
    sweeps = (_independent_runs if independent else _chained_sweeps)(params, begin, end, size)
    short = end - begin <= _run_length(params, size, _COARSE_LEVEL)
    return [_sweep_task(group) for group in _grouped(_of_layer(sweeps, layer), short)]


def _needed(intervals: Mapping[str, KeyInterval], video: VideoInfo, layer: int) -> list[str]:
    """Keys of the intervals with a frame to paint, and of those from which they continue, in order."""
    if not video.is_piece:
        return list(intervals)
    found: set[str] = set()
    waiting = [key for key, own in intervals.items() if own.first < video.stop and own.last > video.first]
    while waiting:
        found.add(key := waiting.pop())
        waiting += [after for _, start in intervals[key].fixed if (after := interval_key(start, layer)) not in found]
    return [key for key in intervals if key in found]


def _grouped(sweeps: Sweeps, short: bool) -> Iterator[list[tuple[str, SweepTask]]]:
    """Group sweeps into tasks: the coarse levels of a short shot are one task, since each task has a fixed overhead."""
    coarse: list[tuple[str, SweepTask]] = []
    for key, sweep in sweeps:
        if short and sweep.level >= _COARSE_LEVEL:
            coarse.append((key, sweep))
            continue
        if coarse:
            yield coarse
            coarse = []
        yield [(key, sweep)]
    if coarse:
        yield coarse


def _of_layer(sweeps: Sweeps, layer: int) -> Sweeps:
    """Assign sweeps to a layer: its number, and task keys with its prefix."""
    prefix = f"layer-{layer}-" if layer >= 0 else ""

    def prefixed(key: str) -> str:
        return prefix + key if key else ""

    for key, sweep in sweeps:
        previous, neighbour = prefixed(sweep.previous), prefixed(sweep.neighbour)
        yield prefixed(key), replace(sweep, layer=layer, previous=previous, neighbour=neighbour)


def plan_composite(context: PlanContext[AnalogyParams]) -> list[Task]:
    """Runs of frames; none without layers."""
    scan = context.results["scan"]["video"]
    length = run_frames((context.video.width, context.video.height))
    video, stop = context.video, scan["frames"]
    if video.is_piece:
        stop = min(stop, video.stop)
    starts = range(video.first, stop, length) if scan["layers"] else ()
    runs = [(start, min(start + length, stop)) for start in starts]
    return [Task(f"frames-{start:07d}", {}, (), (start, stop), 0.05 * (stop - start)) for start, stop in runs]


def _interval_task(key: str, interval: KeyInterval) -> Task:
    frames = interval.last - interval.first
    emits = (interval.first, interval.last) if interval.layer < 0 else None
    after = tuple(interval_key(start, interval.layer) for _, start in interval.fixed)
    return Task(key, {"interval": asdict(interval)}, after, emits, weight=1.3 * frames)


def _sweep_task(group: list[tuple[str, SweepTask]]) -> Task:
    """A task that runs sweeps one after the other, named after the last."""
    *earlier, (key, last) = group
    inside = {name for name, _ in earlier}
    needed = (name for _, sweep in group for name in (sweep.previous, sweep.neighbour))
    after = tuple(dict.fromkeys(name for name in needed if name and name not in inside))
    emits = (last.start, last.stop) if last.layer < 0 and (last.level < 0 or last.last) else None
    args = last.args() | ({"earlier": [[name, sweep.args()] for name, sweep in earlier]} if earlier else {})
    return Task(key, args, after, emits, weight=sum(_weight(sweep) for _, sweep in group))


_FINE_WEIGHT = 0.4
"""Time of a sweep of a fine level, as a multiple of that of a sweep with all rounds."""


def _weight(sweep: SweepTask) -> float:
    full = 1.0 if sweep.level < 0 else 0.375 * 0.25**sweep.level
    return (sweep.stop - sweep.start) * full * (_FINE_WEIGHT if sweep.fine else 1.0)


def _independent_runs(params: AnalogyParams, begin: int, end: int, size: tuple[int, int]) -> Sweeps:
    """Runs of frames that are synthesised independently."""
    length = _run_length(params, size)
    for start in range(begin, end, length):
        yield f"frames-{start:07d}", SweepTask(begin, end, start, min(start + length, end))


def _chained_sweeps(params: AnalogyParams, begin: int, end: int, size: tuple[int, int]) -> Sweeps:
    """All sweeps of a shot, run by run, with the tasks that each depends on."""
    fine = fine_levels(params, size)
    sweeps = [
        (level, sweep)
        for level in reversed(range(params.levels))
        for sweep in range(2 * params.sweeps)
        if level >= fine or is_forward(params, sweep)
    ]
    before: tuple[int, int] | None = None

    def key(level: int, sweep: int, frame: int) -> str:
        """Key of the task whose run contains a frame."""
        start = frame - (frame - begin) % _run_length(params, size, level)
        return f"level-{level}-{'forth' if is_forward(params, sweep) else 'back'}-{sweep // 2}-{start:07d}"

    for level, sweep in sweeps:
        forward, length = is_forward(params, sweep), _run_length(params, size, level)
        runs = [(start, min(start + length, end)) for start in range(begin, end, length)]
        ordered = runs if forward else runs[::-1]
        for place, (start, stop) in enumerate(ordered):
            yield key(level, sweep, start), SweepTask(
                begin, end, start, stop, level, forward,
                first=before is None, last=(level, sweep) == sweeps[-1],
                previous=key(*before, start) if before else "",
                neighbour=key(level, sweep, ordered[place - 1][0]) if place else "",
                from_coarser=before is not None and before[0] != level, sweep=sweep, fine=level < fine,
            )  # fmt: skip
        before = (level, sweep)


def is_forward(params: AnalogyParams, sweep: int) -> bool:
    """Whether a sweep goes forward in time: by default the second of each pair.

    Departure: the paper goes forward, then backward (`sweep_order=forward-first`). Here the last sweep is the forward
    one, because viewers compare each frame with the frame before it, and optical flow is not symmetric.
    """
    return sweep % 2 == (0 if params.sweep_order == "forward-first" else 1)


def fine_levels(params: AnalogyParams, size: tuple[int, int]) -> int:
    """Number of finest levels with one forward sweep instead of all sweeps; never the coarsest level.

    Departure: the paper has both sweeps at every level. With one, a frame starts from the frame before it, advected,
    and needs fewer rounds. The first frame, from which all others continue, has more. Small frames have
    both sweeps: with one, the flicker of a clip of 480x360 rose by 4.3 %, that of one of 1080p by 0.5 %.
    """
    full = params.refinement == "full" or (params.refinement == "auto" and min(size) < FAST_FROM_ROWS)
    if full or params.sweeps > 1 or params.sweep_order == "forward-first":
        return 0
    return min(FINE_LEVELS, levels_of(params, size, min(size)) - 1)


def further_keys(context: PlanContext[AnalogyParams]) -> int:
    """Maximum number of keyframes that are the style of an interval beside the two at its ends."""
    scan = context.results.get("scan", {}).get("video", {})
    most = key_limit((context.video.width, context.video.height))
    sources = [each for layer in (scan, *scan.get("layers", ())) for each in layer.get("sources", ())]
    return 2 * max((min(len(side), most) - 1 for _, *both in sources for side in both), default=0)
