"""The plan of a job: how the steps scan, synthesise and composite are divided into tasks.

scan         one pass over the video and its layers: frame count, cuts, tones, keyframes
synthesise   layers, shots and intervals between keyframes are independent of each other.
             Without keyframes: from the coarsest level to the finest, each level backward and then forward in time,
             in runs of frames. One task is one run of one sweep; it starts from the artefacts of the run before, so a
             restart repeats at most one run. Runs of coarse levels have more frames, since their offsets take a
             sixteenth of the memory. The coarse levels of a short shot (a fifth of its work) are one task.
             Independent frames (temporal = off, stills): runs without dependencies
composite    composites the layers, in runs of frames; no tasks without layers

Intervals (section 4 of benard2013stylizing): keyframes are hard constraints, so frames before the first key, between
two keys and after the last key are independent. A long interval is divided into parts, from its keyframes to its
middle: each part starts from the last frame of the part nearer to the keyframe, which is fixed like a keyframe. The
interval before a keyframe that is painted in parts fills it, and the interval after it starts from the filled frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from types import MappingProxyType

from pipeline.methods.analogy.level_animation import levels_of
from pipeline.methods.analogy.params import AnalogyParams, overridden
from pipeline.methods.base import PlanContext, Task, TaskResult, VideoInfo
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
MAX_INTERVAL_FRAMES = 48
"""Maximum number of frames of an interval; a task holds all of them at one level. The paper has a key every 10 to
20."""
_MIN_INTERVAL_FRAMES = 8
MAX_INTERVAL_BYTES = 3 << 30
MAX_STYLE_PX = 1 << 26
"""Maximum number of pixels of the keyframes that are the style of an interval, if they are painted in parts."""
_MAX_SIDE_KEYS = 6
_INTERVAL_FRAME_BYTES = 60
"""Memory of one frame of an interval at the finest level, bytes per pixel: offsets, pictures, motion in both
directions, two ribbons."""


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
    length = run_frames(size) // 2 * 2 if params.on_twos == "on" else run_frames(size)
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
            sources, see `key_sources`; its own parameters.
    """
    params = overridden(context.params, found.get("params", {}))
    size = (context.video.width, context.video.height)
    sources = {int(index): (behind, ahead) for index, behind, ahead in found.get("sources", [])}
    tasks: list[Task] = []
    video = context.video
    for begin, end in delivered_shots(context, scan):
        keys = [(int(index), bool(full)) for index, full in found["keys"] if begin <= index < end]
        if keys:
            unit, most = 2 if params.on_twos == "on" else 1, key_limit(size)
            limited = {index: (behind[:most], ahead[:most]) for index, (behind, ahead) in sources.items()}
            intervals = dict(split_intervals(begin, end, keys, interval_frames(size), layer, limited, unit))
            if params.temporal == "off":
                intervals = {key: replace(each, fixed=()) for key, each in intervals.items()}
            tasks += [_interval_task(key, intervals[key]) for key in _needed(intervals, video, layer)]
            continue
        if video.is_piece:
            begin, end = max(begin, video.first), min(end, video.stop)
        independent = params.temporal == "off" or end - begin == 1
        sweeps = (_independent_runs if independent else _chained_sweeps)(params, begin, end, size)
        short = end - begin <= _run_length(params, size, _COARSE_LEVEL)
        tasks += [_sweep_task(group) for group in _grouped(_of_layer(sweeps, layer), short)]
    return tasks


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


# -- intervals between keyframes


@dataclass(frozen=True)
class KeyInterval:
    """Frames [start, stop) to synthesise, of which [first, last) are emitted.

    Attributes:
        keys: frame numbers of the keyframes that are the style: those at the ends, and those that paint what these
            leave unpainted.
        fixed: (frame, first frame of the interval that has synthesised it) of frames that are fixed like keyframes.
        layer: number of the layer; -1 = the whole picture.
    """

    start: int
    stop: int
    first: int
    last: int
    keys: tuple[int, ...]
    fixed: tuple[tuple[int, int], ...] = ()
    layer: int = -1


def interval_frames(size: tuple[int, int]) -> int:
    """Maximum number of frames of an interval at a frame size (width, height) px: 24 at 1080p."""
    fitting = MAX_INTERVAL_BYTES // (size[0] * size[1] * _INTERVAL_FRAME_BYTES)
    return max(_MIN_INTERVAL_FRAMES, min(MAX_INTERVAL_FRAMES, fitting))


def key_limit(size: tuple[int, int]) -> int:
    """Maximum number of keyframes on each side of an interval that are its style, at a frame size (width, height)."""
    return max(1, min(_MAX_SIDE_KEYS, MAX_STYLE_PX // (2 * size[0] * size[1])))


def further_keys(context: PlanContext[AnalogyParams]) -> int:
    """Maximum number of keyframes that are the style of an interval beside the two at its ends."""
    scan = context.results.get("scan", {}).get("video", {})
    most = key_limit((context.video.width, context.video.height))
    sources = [each for layer in (scan, *scan.get("layers", ())) for each in layer.get("sources", ())]
    return 2 * max((min(len(side), most) - 1 for _, *both in sources for side in both), default=0)


def split_intervals(
    begin: int,
    end: int,
    keys: list[tuple[int, bool]],
    most: int = MAX_INTERVAL_FRAMES,
    layer: int = -1,
    sources: Mapping[int, tuple[Sequence[int], Sequence[int]]] = MappingProxyType({}),
    unit: int = 1,
) -> Iterator[tuple[str, KeyInterval]]:
    """Split the frames [begin, end) of a shot at its keyframes; yields (task key, interval).

    Args:
        keys: (frame number, whether the keyframe is painted everywhere).
        most: maximum number of frames of an interval.
        layer: number of the layer; -1 = the whole picture.
        sources: keyframes that are the style before and after a keyframe, see `key_sources`; itself if not given.
        unit: number of frames that show one painting; parts begin at multiples of it from the keyframe.
    """
    full = dict(keys)
    # A keyframe that is the last frame belongs to the interval before it, since a task of its own takes half a second.
    ending = end - 1 if end - 1 in full and end - 1 > begin else end
    filled_by: int | None = None
    """First frame of the part before, whose last frame is the keyframe from which the next interval starts."""
    for left, right in pairwise(sorted({begin, *full, ending})):
        stop = right + 1 if right in full else right
        before = sources.get(left, ((left,), ()))[0] if left in full else ()
        after = sources.get(right, ((), (right,)))[1] if right in full else ()
        style, next_filled_by = tuple(sorted({*before, *after})), None
        for part in _interval_parts(left, right, stop, style, (left in full, right in full), most // unit * unit, unit):
            fixed = part.fixed
            if part.start == left and filled_by is not None and not full[left]:
                fixed = ((left, filled_by), *fixed)
            last = end if part.last == ending else part.last
            next_filled_by = part.start if part.last == right else next_filled_by
            yield interval_key(part.start, layer), replace(part, last=last, layer=layer, fixed=fixed)
        filled_by = next_filled_by


def interval_key(start: int, layer: int = -1) -> str:
    """Key of the task that synthesises the interval from frame `start` on."""
    return f"layer-{layer}-keyed-{start:07d}" if layer >= 0 else f"keyed-{start:07d}"


def _interval_parts(
    left: int, right: int, stop: int, keys: tuple[int, ...], keyed: tuple[bool, bool], most: int, unit: int
) -> Iterator[KeyInterval]:
    """Divide one interval into parts of at most `most` frames, in the order of their dependencies.

    Neighbouring parts share a frame, which the part nearer to a keyframe synthesises. Between two keyframes, parts
    continue from both of them, and the part in the middle, of `most` frames, leads from one side to the other.

    Args:
        keyed: whether the frames `left` and `right` are keyframes.
        unit: see `split_intervals`.
    """
    forward_end, backward_begin = right, right
    if right - left > most and all(keyed):
        forward_end = left + (right - left - most + 1) // 2 // unit * unit
        backward_begin = forward_end + most
    elif keyed == (False, True):
        forward_end = backward_begin = left

    def part(start: int, inner: int, fixed: dict[int, int]) -> KeyInterval:
        """The part that emits [start, inner); `fixed`: frame -> first frame of the part that has synthesised it."""
        return KeyInterval(start, stop if inner == right else inner + 1, start, inner, keys, tuple(fixed.items()))

    before, after = left, right
    for start in range(left, forward_end, most):
        inner = min(start + most, forward_end)
        yield part(start, inner, {start: before} if start > left else {})
        before = start
    for start in reversed(range(backward_begin, right, most)):
        inner = min(start + most, right)
        yield part(start, inner, {inner: after} if inner < right else {})
        after = start
    if forward_end < backward_begin:
        outer = {forward_end: before} if forward_end > left else {}
        outer |= {backward_begin: after} if backward_begin < right else {}
        yield part(forward_end, backward_begin, outer)
