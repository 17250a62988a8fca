"""Plan of a job: shots are processed in parallel, runs of frames within a shot in sequence.

    scan      one pass over both videos: they match, number of frames, first frames of the shots
    steady    runs of at most RUN_FRAMES frames; a run continues from the state that the previous run of the shot saved

The saved state is complete, so the result equals that of one filter over the whole video byte for byte. With
`look_ahead`, a run also steadies the frames after it that its last frames are averaged with.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from pipeline.arrays import AnyArray, Arrays
from pipeline.errors import BadInput
from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.executors import INLINE, RowExecutor
from pipeline.kernels.processors import usable_processors
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.given_motion import given_motion
from pipeline.methods.masks import fitted, mask_plane
from pipeline.methods.scan import delivered_shots, scan_video
from pipeline.methods.steady.confidence import motion
from pipeline.methods.steady.filter import SourceAnalysis, SteadyFilter
from pipeline.methods.steady.params import SteadyParams
from pipeline.methods.steady.two_sided import COMPLETE, WINDOW, FilteredFrame, average_backwards

RUN_FRAMES = 96
"""Frames per task, which are repeated after a failure."""
AHEAD = 2
"""Frames by which the analysis of the source is ahead of the rest."""
MANY_PROCESSORS = 4
FLOW_THREADS, ROW_THREADS = 4, 4
"""On so many processors, threads that estimate flow, each between other frames, twice as far ahead; and threads that
take rows of an analysis or a result besides the thread that makes it."""


@dataclass(frozen=True)
class _Waiting:
    """A frame whose source is being analysed."""

    analysis: Future[SourceAnalysis | None]
    styled: AnyArray
    mask: Plane | None


def plan_scan(context: PlanContext[SteadyParams]) -> list[Task]:
    return [Task("video", weight=0.2 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[SteadyParams]) -> TaskResult:
    """Result: number of frames, and cuts.

    Raises:
        BadInput: the styled video has another frame size or another number of frames than the video.
    """
    video, first = context.video, context.video.first
    stop = min(video.stop + WINDOW * context.params.look_ahead, video.total) if video.is_piece else None
    styled = context.frames("styled", first, stop)
    matched = 0

    def compare(frame: Frame) -> None:
        nonlocal matched
        other = next(styled, None)
        if other is not None:
            matched += 1
            _check_size(frame, other)

    span = (first, stop) if video.is_piece else (None, None)
    frames, cuts = scan_video(context, context.params.cut_sensitivity, compare, span)
    given = matched + sum(1 for _ in styled)
    if given != frames - first:
        raise BadInput(
            f"The styled video has {given} frames, the video has {frames - first}.", field="inputs.styled", value=given,
            remedy="Give a styled video with one frame for each frame of the video, for example made from all of its "
            "frames without a change of the frame rate.",
        )  # fmt: skip
    return {"frames": frames, "cuts": list[int](cuts)}


def _check_size(frame: Frame, styled: Frame) -> None:
    size, other = (frame.shape[1], frame.shape[0]), (styled.shape[1], styled.shape[0])
    if size == other:
        return
    scales = Fraction(other[0], size[0]), Fraction(other[1], size[1])
    if abs(scales[0] / scales[1] - 1) < Fraction(1, 100):
        difference = f"; its scale is {float(scales[0]):.3g}"
        remedy = f"Scale the styled video to {size[0]}x{size[1]}, or the video to {other[0]}x{other[1]}."
    else:
        difference = ", and another aspect ratio"
        remedy = "Give a styled video that was made from the whole frames of the video, neither cropped nor padded."
    raise BadInput(
        f"The styled video is {other[0]}x{other[1]}, the video is {size[0]}x{size[1]}{difference}.",
        field="inputs.styled", value=f"{other[0]}x{other[1]}", remedy=remedy,
    )  # fmt: skip


def plan_steady(context: PlanContext[SteadyParams]) -> list[Task]:
    scan = context.results["scan"]["video"]
    tasks: list[Task] = []
    for begin, end in delivered_shots(context, scan):
        last = min(end, context.video.stop) if context.video.is_piece else end
        for start in range(begin, last, RUN_FRAMES):
            stop = min(start + RUN_FRAMES, last)
            after = (_key(start - RUN_FRAMES),) if start > begin else ()
            ahead = _needed(start, stop, min(start + RUN_FRAMES, end), end, context.params.look_ahead)
            args = {"start": start, "stop": stop, "ahead": ahead, "last": stop == last}
            tasks.append(Task(_key(start), args, after, (start, stop), weight=stop - start))
    return tasks


def _needed(start: int, stop: int, film_stop: int, end: int, look_ahead: int) -> int:
    """The frame after the last on which frames [start, stop) of a run [start, film_stop) of the film depend."""
    complete = COMPLETE * look_ahead
    window = (stop - 1 - start) // complete if complete else 0
    return min(start + window * complete + WINDOW * look_ahead if look_ahead else stop, film_stop + look_ahead, end)


def _key(start: int) -> str:
    return f"run-{start:07d}"


def run_steady(task: Task, context: TaskContext[SteadyParams]) -> TaskResult:
    """Emit frames [start, stop), continuing from the state of the previous run of the shot."""
    start, stop = task.args["start"], task.args["stop"]
    with ThreadPoolExecutor(ROW_THREADS, "impasto-rows") as threads:
        background = RowExecutor(threads, ROW_THREADS) if usable_processors() >= MANY_PROCESSORS else INLINE
        steady = SteadyFilter(context.params, context.size, context.deep, background)
        if task.after:
            steady.restore(context.load("steady", task.after[0]))
        for index, result in _results(steady, task, context):
            if index < stop:
                context.emit(index, result)
                context.progress((index + 1 - start) / (stop - start))
    return {"frames": stop - start}


def _results(steady: SteadyFilter, task: Task, context: TaskContext[SteadyParams]) -> Iterator[tuple[int, AnyArray]]:
    """Indices and results of the frames of a task, and of those after it that were needed."""
    frames, ahead = _forwards(steady, task, context), context.params.look_ahead
    if ahead:
        yield from average_backwards(frames, ahead)
    else:
        yield from ((frame.index, frame.result) for frame in frames)


def _forwards(steady: SteadyFilter, task: Task, context: TaskContext[SteadyParams]) -> Iterator[FilteredFrame]:
    """The pass forwards over frames [start, ahead); saves the state after the last frame of the run."""
    start, stop, ahead = task.args["start"], task.args["stop"], task.args["ahead"]
    wanted = [name for name in ("flow", "occlusion") if context.wants_pass(name)]
    yield from _part(steady, start, stop, context, wanted)
    if not task.args["last"]:
        context.save(task.key, steady.state())
    yield from _part(steady, stop, ahead, context)


def _part(
    steady: SteadyFilter, begin: int, end: int, context: TaskContext[SteadyParams], passes: Sequence[str] = ()
) -> Iterator[FilteredFrame]:
    """Frames [begin, end) after the first pass; emits these passes of them."""
    for index, frame in enumerate(_analyzed(steady, begin, end, context), begin):
        analysis = frame.analysis.result()
        if passes:
            made = _passes(analysis, context.size)
            context.emit_passes(index, {name: made[name] for name in passes})
        with context.clock("steady"):
            result = steady.apply(analysis, frame.styled, frame.mask, index)
        yield FilteredFrame(index, result, frame.mask, analysis.onward if analysis else None)


def _passes(analysis: SourceAnalysis | None, size: tuple[int, int]) -> Arrays:
    if analysis is None:
        return {"flow": np.zeros((*size[::-1], 2), np.float32), "occlusion": np.ones(size[::-1], np.float32)}
    x, y = analysis.back.to
    columns, rows = (np.arange(side, dtype=np.float32) for side in size)
    return {"flow": np.dstack([x - columns, y - rows[:, None]]), "occlusion": 1 - analysis.back.trust}


def _analyzed(steady: SteadyFilter, start: int, stop: int, context: TaskContext[SteadyParams]) -> Iterator[_Waiting]:
    """Frames with their analysis to come. One thread, or several, estimate the optical flow some frames ahead, another
    one analyses the sources in order. Neither depends on the results, so that the bytes are those of one thread."""

    given = given_motion(context)

    def flows(before: Frame, source: Frame, index: int) -> tuple[Flow, Flow]:
        with context.clock("flow"):
            back, forth = (given.flow(*pair, context.size) for pair in ((index, index - 1), (index - 1, index)))
            if back is not None and forth is not None:
                return back, forth
            return motion(before, source, context.params.look_ahead > 0)

    def analyze(source: Frame, estimated: Future[tuple[Flow, Flow]] | None, index: int) -> SourceAnalysis | None:
        between = None if estimated is None else estimated.result()
        with context.clock("motion"):
            return steady.analyze(source, between, index)

    waiting: deque[_Waiting] = deque()
    before = steady.source
    inputs = (
        context.frames("video", start, stop),
        context.deep_frames("styled", start, stop),
        _masks(context, start, stop),
    )
    threads, ahead = (FLOW_THREADS, 2 * AHEAD) if usable_processors() >= MANY_PROCESSORS else (1, AHEAD)
    with ThreadPoolExecutor(threads, "impasto-flow") as flow, ThreadPoolExecutor(1, "impasto-motion") as thread:
        for index, (source, styled, mask) in enumerate(zip(*inputs, strict=False), start):
            estimated = None if before is None else flow.submit(flows, before, source, index)
            waiting.append(_Waiting(thread.submit(analyze, source, estimated, index), styled, mask))
            before = source
            if len(waiting) > ahead:
                yield waiting.popleft()
        yield from waiting


def _masks(context: TaskContext[SteadyParams], start: int, stop: int) -> Iterator[Plane | None]:
    """The mask of each frame: the latest image up to it, None before the first image."""
    images = context.images("mask") if context.has("mask") else {}
    newest = max((number for number in images if number <= start), default=None)
    mask = None if newest is None else _mask(images, newest, context.size)
    for index in range(start, stop):
        if index in images and index != newest:
            mask = _mask(images, index, context.size)
        yield mask


def _mask(images: Mapping[int, AnyArray], index: int, size: tuple[int, int]) -> Plane:
    return fitted(mask_plane(images[index]), size, f"inputs.mask[{index}]")
