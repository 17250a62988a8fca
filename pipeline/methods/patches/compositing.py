"""Step "paint": each frame is composited from warped patches, over a painting of the pixels that no patch covers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Plane
from pipeline.kernels.ahead import ahead, helpers
from pipeline.kernels.executors import FrameExecutor
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.artefacts import LabelPictures
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.face_tracking import ShotFaces, single_frame_planes
from pipeline.methods.patches.frame_passes import FramePasses, PatchTrace
from pipeline.methods.patches.paint_error import Rendering, error_tolerance, patch_weight
from pipeline.methods.patches.paint_sum import WeightedSum, add_weighted, blended
from pipeline.methods.patches.painted_patch import PaintedPatch
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import PatchTrack, patch_tracks
from pipeline.methods.patches.residual_layer import FADE_PAINTINGS, VISIBLE_OPACITY, FirstPainting, ResidualLayer
from pipeline.methods.patches.scan import RUN, WorkingGrid, painting_runs, run_key
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.regions.mattes import LabelMattes
from pipeline.strokes.steepen import steepen_wide, steepened_wide
from pipeline.video.depth import as_float, as_uint16
from pipeline.warp.panorama import Placement, full_map

SHARPENING, SHARPENING_STEPS = 0.4, 1
"""Largest share, and steps, of the steepening of wide edges in the frames of a run, see `steepened_wide`."""
SHARPENED_LINES = 480, 720
"""Shorter sides of frames, px, up to which they are not sharpened, because it adds flicker and their edges are narrow
enough, and from which on they are sharpened in full."""


def plan_paint(context: PlanContext[PatchesParams]) -> list[Task]:
    """Tasks of a run of frames.

    run-<run>     paints the run's frames
    first-<run>   paints its first frame before, since the run before it is cross-faded to that painting
    """
    every = patch_tracks(context) if context.params.temporal == "on" else []
    fades = cross_fades(context.params)
    tasks: dict[str, Task] = {}
    for start, stop, begin, end in painting_runs(context):
        edges = [edge for edge in (start, stop) if fades and begin < edge < end]
        for edge in edges:
            first = Task(first_key(edge), _task_args(every, (edge, edge + 1, begin, end), context), weight=1)
            tasks.setdefault(first.key, first)
        args = _task_args(every, (start, stop, begin, end), context)
        after = tuple(map(first_key, edges))
        tasks[run_key(start)] = Task(run_key(start), args, after, (start, stop), weight=stop - start)
    return list(tasks.values())


def _task_args(
    every: Sequence[PatchTrack], run: tuple[int, int, int, int], context: PlanContext[PatchesParams]
) -> TaskResult:
    """Arguments of a task that paints frames [start, stop) of the shot [begin, end)."""
    start, stop, begin, end = run
    kind = context.params.table_area
    tracks = [
        track.args(kind) for track in every if track.begin == begin and track.start < stop and track.stop > start
    ]  # fmt: skip
    results = [context.results["patch"][track["key"]] for track in tracks]
    return {"start": start, "stop": stop, "begin": begin, "end": end, "tracks": tracks, "results": results}


def cross_fades(params: PatchesParams) -> bool:
    """Whether runs are cross-faded: the fade has room in a run."""
    return params.temporal == "on" and RUN // params.frames_per_painting >= FADE_PAINTINGS


def first_key(start: int) -> str:
    """Key of the task that paints the first frame of the run that starts at frame `start`."""
    return f"first-{start:07d}"


def run_paint(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Paint and emit frames [start, stop), and save the artefacts of label maps; or paint a run's first frame."""
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    with helpers(1, "impasto-layers") as threads:
        if task.key == first_key(start):
            _paint_first(task, context, FrameExecutor(threads))
            return {}
        _paint_frames(task, context, FrameExecutor(threads))
    pictures = LabelPictures(context)
    if context.params.temporal == "on" and pictures.requested:
        maps = LabelMaps(context, begin)
        for index, frame in enumerate(context.frames("video", start, stop), start=start):
            pictures.add(index, LabelMattes(maps.require(index), frame), maps.uncertainty(index))
        pictures.save(task.key)
    return {}


def _paint_frames(task: Task, context: TaskContext[PatchesParams], background: FrameExecutor) -> None:
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    paint = _frame_painter(task, context, background)
    painting: AnyArray = np.empty((0, 0, 3), np.uint8)
    passes = FramePasses(context, begin)
    if isinstance(paint, PatchCompositor):
        paint.traced = passes.traces
    known = first_key(start) in task.after

    def prepared(given: tuple[int, Frame, bool]) -> tuple[int, Frame, Callable[[], AnyArray] | None]:
        index, frame, is_painted = given
        if not is_painted or (known and index == start and not passes.traces):
            return index, frame, None
        with context.clock("cover"):
            return index, frame, paint.prepare(index, frame)

    with ahead(prepared, frames_to_paint(context, task), 1, "impasto-cover", most=1) as frames:
        for index, frame, painted in frames:
            with context.clock("composite"):
                if known and index == start:
                    painting = _sharpened(_first_painting(paint, start, context), context.params)
                    if painted is not None:
                        painted()  # for its trace
                        _first_painting(paint, start, context)
                elif painted is not None:
                    painting = _sharpened(painted(), context.params)
                if index == _fade_from(task, context.params):
                    _prepare_cross_fade(paint, stop, context)
            passes.emit(index, frame, paint.trace if isinstance(paint, PatchCompositor) else None)
            context.emit(index, painting)
            context.progress((index + 1 - start) / (stop - start))


def _sharpened(painting: AnyArray, params: PatchesParams) -> AnyArray:
    """A frame as it is emitted. Patches and residual layer are sampled between pixels, again in every frame, and faded
    into each other, which makes edges wider from the first to the last frame of a run."""
    fewest, full = SHARPENED_LINES
    share = SHARPENING * min((min(painting.shape[:2]) - fewest) / (full - fewest), 1.0)
    if params.temporal == "off" or share <= 0:
        return painting
    if painting.dtype == np.uint8:
        return steepened_wide(painting, SHARPENING_STEPS, share)
    colours = as_float(painting) * np.float32(255)
    steepen_wide(colours, SHARPENING_STEPS, share)
    return as_uint16(colours / np.float32(255))


def frames_to_paint(context: TaskContext[PatchesParams], task: Task) -> Iterator[tuple[int, Frame, bool]]:
    """Frames of a run: number, frame, and whether it is painted; else the previous painting is repeated."""
    start, stop = task.args["start"], task.args["stop"]
    for index, frame in enumerate(context.frames("video", start, stop), start=start):
        yield index, frame, (index - start) % context.params.frames_per_painting == 0


def _paint_first(task: Task, context: TaskContext[PatchesParams], background: FrameExecutor) -> None:
    """Paint the first frame of a run, and save it and the state after it."""
    start, paint = task.args["start"], PatchCompositor(task, context, background)
    for frame in context.frames("video", start, start + 1):
        with context.clock("composite"):
            context.save(task.key, paint.first(start, frame).state())


def _first_painting(paint: FramePainter, start: int, context: TaskContext[PatchesParams]) -> AnyArray:
    """The painting of a run's first frame that its own task has made; `paint` continues after it."""
    assert isinstance(paint, PatchCompositor)
    return paint.continue_after(FirstPainting.of(start, context.load("paint", first_key(start))))


def _fade_from(task: Task, params: PatchesParams) -> int | None:
    """The last frame of a run before the cross-fade to the next run; None = there is no next run."""
    stop = task.args["stop"]
    return stop - FADE_PAINTINGS * params.frames_per_painting if first_key(stop) in task.after else None


def _prepare_cross_fade(paint: FramePainter, stop: int, context: TaskContext[PatchesParams]) -> None:
    assert isinstance(paint, PatchCompositor)
    if paint.uses_residual_layer:
        paint.prepare_cross_fade(FirstPainting.of(stop, context.load("paint", first_key(stop))))


def _frame_painter(task: Task, context: TaskContext[PatchesParams], background: FrameExecutor) -> FramePainter:
    if context.params.temporal == "off":
        painter = frame_painter(context.params, context.size, context.seed, context.deep)
        return IndependentFrames(painter, context.params.face_detail)
    return PatchCompositor(task, context, background)


def frame_painter(params: PatchesParams, size: tuple[int, int], seed: int, deep: bool = False) -> HertzmannPainter:
    """Painter of whole frames of (width, height) px: the brush sizes of the largest regions."""
    return HertzmannPainter.of(params.style, size[0] * size[1], min(size), params, seed, deep)


@dataclass(frozen=True)
class IndependentFrames:
    """Hertzmann's painter, applied to each frame independently (`temporal=off`)."""

    painter: HertzmannPainter
    face_detail: float = 0.0

    def prepare(self, index: int, frame: Frame) -> Callable[[], AnyArray]:
        """A function that paints frame `index`: uint8 (h, w, 3), or uint16."""
        return partial(self._paint, frame)

    def _paint(self, frame: Frame) -> AnyArray:
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        return self.painter.paint_picture(frame, single_frame_planes(gray, self.face_detail))


@dataclass(frozen=True)
class PatchCover:
    """What the patches paint of a frame: the weighted sum of pictures and paintings, and `covered`, the sum of the
    weights, float32 (h, w); with the tolerated RGB distance `limit`, float32 (h, w)."""

    index: int
    frame: Frame
    total: WeightedSum
    covered: Plane
    limit: Plane
    trace: PatchTrace | None


class PatchCompositor:
    """Composites the frames of a run from patches and the residual layer.

    Attributes:
        traced: whether the `trace` of the last painted frame is kept.

    Args:
        background: its helper takes a part of the work.
    """

    def __init__(self, task: Task, context: TaskContext[PatchesParams], background: FrameExecutor) -> None:
        begin = task.args["begin"]
        self._params: PatchesParams = context.params
        self._grid, self._size = WorkingGrid.of(context.size), context.size
        self._maps = LabelMaps(context, begin)
        start, stop = task.args["start"], task.args["stop"]
        self._patches = [
            PaintedPatch.load(PatchTrack(**args), result, start, stop, context)
            for args, result in zip(task.args["tracks"], task.args["results"], strict=True)
        ]
        painter = frame_painter(context.params, context.size, context.seed, context.deep)
        self._faces = ShotFaces(context, begin)
        self._residual = ResidualLayer(painter, WindowFlow(context, begin), self._grid, background)
        self.traced = False
        self.trace: PatchTrace | None = None

    @property
    def uses_residual_layer(self) -> bool:
        """Whether a frame had a visible residual layer."""
        return self._residual.used

    def prepare(self, index: int, frame: Frame) -> Callable[[], AnyArray]:
        """Compute what patches paint of frame `index`, which does not depend on the frames before it.

        Returns: a function that paints the frame, uint8 (h, w, 3) or uint16, after the frames before it.
        """
        cover = self._cover(index, frame)
        return lambda: self._composite(cover)[1]

    def first(self, index: int, frame: Frame) -> FirstPainting:
        """Paint frame `index`, the first of its run."""
        picture, painting = self._composite(self._cover(index, frame))
        return FirstPainting(index, picture, painting, self._residual.known_opacity, self._residual.used)

    def continue_after(self, first: FirstPainting) -> AnyArray:
        """Continue after a first frame that was painted before; returns its painting."""
        self._residual.restore(first)
        return first.painting

    def prepare_cross_fade(self, following: FirstPainting) -> None:
        """Prepare the residual layer's cross-fade to the first frame of the next run."""
        self._residual.prepare_cross_fade(following, self._params.frames_per_painting)

    def _cover(self, index: int, frame: Frame) -> PatchCover:
        limit = np.float32(self._params.at(index).misfit) * error_tolerance(frame, self._grid.unit)
        if (at_features := self._faces.tolerance(index)) is not None:
            limit = limit * at_features
        trace = PatchTrace.of(self._size) if self.traced else None
        shape = frame.shape[:2]
        cover = PatchCover(
            index, frame, np.zeros((2, *shape, 3), np.float32), np.zeros(shape, np.float32), limit, trace
        )
        mattes = LabelMattes(self._maps.require(index), frame)
        for patch in self._patches:
            if (placement := patch.placements.get(index)) is not None:
                self._add_patch(cover, patch, placement, mattes)
        return cover

    def _composite(self, cover: PatchCover) -> Rendering:
        """Source picture and painting: weighted means of patches and residual layer."""
        index, residual, self.trace = cover.index, self._residual, cover.trace
        opacity = residual.limited_opacity(index, 1 - cover.covered)
        if (opacity > VISIBLE_OPACITY).any():
            layer = residual.paint(index, cover.frame, opacity, cover.limit, self._faces(index))
        else:
            layer, opacity = cover.total, np.zeros_like(cover.covered)
        if self.trace is not None:
            self.trace.finish(cover.covered, opacity)
        picture, painting = blended(cover.total, cover.covered, layer, opacity, residual.painter.deep)
        residual.store(index, picture, painting)
        return picture, painting

    def _add_patch(
        self, cover: PatchCover, patch: PaintedPatch, placement: Placement, mattes: LabelMattes
    ) -> None:  # fmt: skip
        """Add a patch, weighted by its matte, its cross-fade and its fit, to the sums."""
        (left, top, right, bottom), x, y = full_map(placement, self._grid.ratio, self._size, patch.origin)
        box = slice(top, bottom), slice(left, right)
        rendering = patch.sample(cover.index, x, y)
        weight = mattes.normalized(patch.track.label, box) * np.float32(patch.track.fade_weight(cover.index))
        weight *= patch_weight(mattes.frame[box], rendering, cover.limit[box], self._grid)
        add_weighted(cover.total[:, *box], rendering, weight)
        cover.covered[box] += weight
        if cover.trace is not None:
            cover.trace.add(patch.track.key, box, weight, (x, y), patch.stroke_numbers(cover.index, x, y))


FramePainter: TypeAlias = PatchCompositor | IndependentFrames
