"""Step "paint": each frame is composited from warped patches, over a painting of the pixels that no patch covers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.artefacts import LabelPictures
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.face_tracking import ShotFaces, single_frame_planes
from pipeline.methods.patches.mattes import LabelMattes
from pipeline.methods.patches.paint_error import Rendering, error_tolerance, patch_weight
from pipeline.methods.patches.paint_sum import WeightedSum, add_weighted, blended
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_construction import load_placements, period_artefact
from pipeline.methods.patches.patch_track import PatchTrack, patch_tracks
from pipeline.methods.patches.residual_layer import FADE_PAINTINGS, VISIBLE_OPACITY, FirstPainting, ResidualLayer
from pipeline.methods.patches.scan import RUN, WorkingGrid, painting_runs, run_key
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.strokes.steepen import steepened_wide
from pipeline.warp.panorama import Placement, full_map

CUBIC_REACH = 2
"""Pixels on either side of a position that bicubic interpolation reads."""
SHARPENING, SHARPENING_STEPS = 0.4, 1
"""Largest share, and steps, of the steepening of wide edges in the frames of a run, see `steepened_wide`."""
SHARPENED_LINES = 480, 720
"""Shorter sides of frames, px, up to which they are not sharpened, because it adds flicker and their edges are narrow
enough, and from which on they are sharpened in full."""
PERIOD_FADE_FRAMES = 3.0
"""Half length of the cross-fade between two periods of a patch, frames."""


def plan_paint(context: PlanContext[PatchesParams]) -> list[Task]:
    """Tasks of a run of frames.

    run-<run>     paints the run's frames
    first-<run>   paints its first frame before, since the run before it is cross-faded to that painting
    """
    every = patch_tracks(context) if context.params.temporal == "on" else []
    fades = cross_fades(context.params)
    tasks: list[Task] = []
    for start, stop, begin, end in painting_runs(context):
        after = list[str]()
        if fades and start > begin:
            after.append(first_key(start))
        if fades and stop < end:
            tasks.append(Task(first_key(stop), _task_args(every, (stop, stop + 1, begin, end), context), weight=1))
            after.append(first_key(stop))
        args = _task_args(every, (start, stop, begin, end), context)
        tasks.append(Task(run_key(start), args, tuple(after), (start, stop), weight=stop - start))
    return tasks


def _task_args(
    every: Sequence[PatchTrack], run: tuple[int, int, int, int], context: PlanContext[PatchesParams]
) -> TaskResult:
    """Arguments of a task that paints frames [start, stop) of the shot [begin, end)."""
    start, stop, begin, end = run
    tracks = [
        track.args() for track in every if track.begin == begin and track.start < stop and track.stop > start
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
    if task.key == first_key(start):
        _paint_first(task, context)
        return {}
    paint, painting = _frame_painter(task, context), np.empty((0, 0, 3), np.uint8)
    for index, frame in frames_to_paint(context, task):
        with context.clock("composite"):
            if index == start and first_key(start) in task.after:
                painting = _sharpened(_first_painting(paint, start, context), context.params)
            elif frame is not None:
                painting = _sharpened(paint(index, frame), context.params)
            if index == _fade_from(task, context.params):
                _prepare_cross_fade(paint, stop, context)
        context.emit(index, painting)
        context.progress((index + 1 - start) / (stop - start))
    pictures = LabelPictures(context)
    if context.params.temporal == "on" and pictures.requested:
        maps = LabelMaps(context, begin)
        for index, frame in enumerate(context.frames("video", start, stop), start=start):
            pictures.add(index, LabelMattes(maps.require(index), frame), maps.uncertainty(index))
        pictures.save(task.key)
    return {}


def _sharpened(painting: Frame, params: PatchesParams) -> Frame:
    """A frame as it is emitted. Patches and residual layer are sampled between pixels, again in every frame, and faded
    into each other, which makes edges wider from the first to the last frame of a run."""
    fewest, full = SHARPENED_LINES
    share = SHARPENING * min((min(painting.shape[:2]) - fewest) / (full - fewest), 1.0)
    return steepened_wide(painting, SHARPENING_STEPS, share) if params.temporal == "on" and share > 0 else painting


def frames_to_paint(context: TaskContext[PatchesParams], task: Task) -> Iterator[tuple[int, Frame | None]]:
    """Frames of a run; None where the previous painting is repeated."""
    start, stop = task.args["start"], task.args["stop"]
    for index, frame in enumerate(context.frames("video", start, stop), start=start):
        yield index, frame if (index - start) % context.params.frames_per_painting == 0 else None


def _paint_first(task: Task, context: TaskContext[PatchesParams]) -> None:
    """Paint the first frame of a run, and save it and the state after it."""
    start, paint = task.args["start"], PatchCompositor(task, context)
    for frame in context.frames("video", start, start + 1):
        with context.clock("composite"):
            context.save(task.key, paint.first(start, frame).state())


def _first_painting(paint: FramePainter, start: int, context: TaskContext[PatchesParams]) -> Frame:
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


def _frame_painter(task: Task, context: TaskContext[PatchesParams]) -> FramePainter:
    if context.params.temporal == "off":
        return IndependentFrames(frame_painter(context.params, context.size, context.seed), context.params.face_detail)
    return PatchCompositor(task, context)


def frame_painter(params: PatchesParams, size: tuple[int, int], seed: int) -> HertzmannPainter:
    """Painter of whole frames of (width, height) px: the brush sizes of the largest regions."""
    return HertzmannPainter.of(params.style, size[0] * size[1], min(size), params, seed)


@dataclass(frozen=True)
class IndependentFrames:
    """Hertzmann's painter, applied to each frame independently (`temporal=off`)."""

    painter: HertzmannPainter
    face_detail: float = 0.0

    def __call__(self, index: int, frame: Frame) -> Frame:
        """Paint frame `index`: uint8 (h, w, 3)."""
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        return self.painter.paint_picture(frame, single_frame_planes(gray, self.face_detail))


@dataclass(frozen=True)
class PaintedPatch:
    """A painted patch, loaded for the frames of one run.

    Attributes:
        track: frames and label of the patch.
        periods: frames [start, stop) of each period of similar appearance.
        renderings: panorama and painting, uint8 (h, w, 3), of the loaded periods, by number.
        origin: (x, y) of the panorama's top left pixel, px; the same for all periods.
        placements: placement in the panorama, by frame.
    """

    track: PatchTrack
    periods: list[list[int]]
    renderings: dict[int, tuple[Frame, Frame]]
    origin: tuple[int, int]
    placements: dict[int, Placement]

    @classmethod
    def load(
        cls, track: PatchTrack, result: TaskResult, start: int, stop: int, context: TaskContext[PatchesParams]
    ) -> PaintedPatch:
        """Load the parts of a patch that are needed for frames [start, stop).

        Args:
            result: result of the patch's task in the step "patch".
        """
        placements, renderings = load_placements(context, track, start, stop), {}
        for number, (first, last) in enumerate(result["periods"]):
            if first - PERIOD_FADE_FRAMES < stop and last + PERIOD_FADE_FRAMES > start:
                arrays = context.load("patch", period_artefact(track, number))
                renderings[number] = arrays["panorama"], arrays["painting"]
        x, y = result["origin"]
        return cls(track, result["periods"], renderings, (x, y), placements)

    def sample(self, index: int, x: Plane, y: Plane) -> Rendering:
        """Sample panorama and painting for frame `index`: uint8 (2, h, w, 3). Successive periods are cross-faded.

        Args:
            x, y: float32 (h, w), positions in the panorama, px.
        """
        out = np.empty((2, *x.shape, 3), np.uint8)
        (picture, painting), (x, y) = self._shown(index, x, y)
        cv2.remap(picture, x, y, cv2.INTER_LINEAR, dst=out[0], borderMode=cv2.BORDER_REPLICATE)
        cv2.remap(painting, x, y, cv2.INTER_CUBIC, dst=out[1], borderMode=cv2.BORDER_REPLICATE)
        return out

    def _shown(self, index: int, x: Plane, y: Plane) -> tuple[tuple[Frame, Frame], tuple[Plane, Plane]]:
        """Panorama and painting that frame `index` shows, and the positions in them.

        Of two periods, the part around the positions is blended: to sample it once takes less than to sample both.
        """
        (number, weight), *before_or_after = self._period_weights(index)
        if not before_or_after or not x.size:
            return self.renderings[number], (x, y)
        (other, rest), (height, width) = before_or_after[0], self.renderings[number][0].shape[:2]
        rows, columns = _around(y, height), _around(x, width)
        picture, painting = (
            np.asarray(cv2.addWeighted(own[rows, columns], weight, its[rows, columns], rest, 0), np.uint8)
            for own, its in zip(self.renderings[number], self.renderings[other], strict=True)
        )
        return (picture, painting), (x - np.float32(columns.start), y - np.float32(rows.start))

    def _period_weights(self, index: int) -> list[tuple[int, float]]:
        """Numbers of the periods shown at frame `index`, and their cross-fade weights."""
        number = next(n for n, (first, last) in enumerate(self.periods) if first <= index < last)
        first, last = self.periods[number]
        since, until = index - first + 0.5, last - index - 0.5
        if number > 0 and since < PERIOD_FADE_FRAMES and since <= until:
            weight = 0.5 + since / (2 * PERIOD_FADE_FRAMES)
            return [(number, weight), (number - 1, 1 - weight)]
        if number + 1 < len(self.periods) and until < PERIOD_FADE_FRAMES:
            weight = 0.5 + until / (2 * PERIOD_FADE_FRAMES)
            return [(number, weight), (number + 1, 1 - weight)]
        return [(number, 1.0)]


def _around(positions: Plane, length: int) -> slice:
    """Pixels on an axis of that length that are read to interpolate at the positions, px; at least one."""
    low, high = int(np.floor(positions.min())) - CUBIC_REACH, int(np.ceil(positions.max())) + CUBIC_REACH + 1
    start = min(max(low, 0), length - 1)
    return slice(start, max(min(high, length), start + 1))


class PatchCompositor:
    """Composites the frames of a run from patches and the residual layer."""

    def __init__(self, task: Task, context: TaskContext[PatchesParams]) -> None:
        begin = task.args["begin"]
        self._params: PatchesParams = context.params
        self._grid, self._size = WorkingGrid.of(context.size), context.size
        self._maps = LabelMaps(context, begin)
        start, stop = task.args["start"], task.args["stop"]
        self._patches = [
            PaintedPatch.load(PatchTrack(**args), result, start, stop, context)
            for args, result in zip(task.args["tracks"], task.args["results"], strict=True)
        ]
        painter = frame_painter(context.params, context.size, context.seed)
        self._faces = ShotFaces(context, begin)
        self._residual = ResidualLayer(painter, WindowFlow(context, begin), self._grid)

    @property
    def uses_residual_layer(self) -> bool:
        """Whether a frame had a visible residual layer."""
        return self._residual.used

    def __call__(self, index: int, frame: Frame) -> Frame:
        """Paint frame `index`: uint8 (h, w, 3)."""
        return self._composite(index, frame)[1]

    def first(self, index: int, frame: Frame) -> FirstPainting:
        """Paint frame `index`, the first of its run."""
        picture, painting = self._composite(index, frame)
        return FirstPainting(index, picture, painting, self._residual.known_opacity, self._residual.used)

    def continue_after(self, first: FirstPainting) -> Frame:
        """Continue after a first frame that was painted before; returns its painting."""
        self._residual.restore(first)
        return first.painting

    def prepare_cross_fade(self, following: FirstPainting) -> None:
        """Prepare the residual layer's cross-fade to the first frame of the next run."""
        self._residual.prepare_cross_fade(following, self._params.frames_per_painting)

    def _composite(self, index: int, frame: Frame) -> tuple[Frame, Frame]:
        """Source picture and painting, uint8 (h, w, 3) each: weighted means of patches and residual layer."""
        limit = np.float32(self._params.misfit) * error_tolerance(frame, self._grid.unit)
        if (at_features := self._faces.tolerance(index)) is not None:
            limit = limit * at_features
        total = np.zeros((2, *frame.shape), np.float32)
        covered = np.zeros(frame.shape[:2], np.float32)
        mattes = LabelMattes(self._maps.require(index), frame)
        for patch in self._patches:
            if (placement := patch.placements.get(index)) is not None:
                self._add_patch(total, covered, patch, placement, mattes, index, limit)
        residual = self._residual
        opacity = residual.limited_opacity(index, 1 - covered)
        if (opacity > VISIBLE_OPACITY).any():
            layer = residual.paint(index, frame, opacity, limit, self._faces(index))
        else:
            layer, opacity = total, np.zeros_like(covered)
        picture, painting = blended(total, covered, layer, opacity)
        residual.store(index, picture, painting)
        return picture, painting

    def _add_patch(
        self, total: WeightedSum, covered: Plane, patch: PaintedPatch, placement: Placement, mattes: LabelMattes,
        index: int, limit: Plane,
    ) -> None:  # fmt: skip
        """Add a patch, weighted by its matte, its cross-fade and its fit, to `total`, and the weight to `covered`."""
        (left, top, right, bottom), x, y = full_map(placement, self._grid.ratio, self._size, patch.origin)
        box = slice(top, bottom), slice(left, right)
        rendering = patch.sample(index, x, y)
        weight = mattes.normalized(patch.track.label, box) * np.float32(patch.track.fade_weight(index))
        weight *= patch_weight(mattes.frame[box], rendering, limit[box], self._grid)
        add_weighted(total[:, *box], rendering, weight)
        covered[box] += weight


FramePainter: TypeAlias = PatchCompositor | IndependentFrames
