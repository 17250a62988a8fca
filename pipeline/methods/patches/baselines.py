"""Baselines for comparison: independently painted frames, and strokes advected from frame to frame by optical flow.

An advected stroke keeps its id and thereby its jitter, bristles and painting order. It moves with the flow and follows
the picture's colour. Strokes that are crowded, occluded or no longer needed are removed; new ones are added where paint
is missing. Only past frames are used. Sources: litwinowicz1997processing, hays2004image.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.base import Task, TaskContext
from pipeline.methods.patches.face_tracking import single_frame_planes
from pipeline.methods.patches.layer_picture import LayerPicture
from pipeline.methods.patches.paint_error import error_tolerance
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.strokes.brush import Canvas, blank
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import layer_brush, spacing_px, wanted
from pipeline.strokes.seeds import place
from pipeline.strokes.tracks import StrokeTracks, advect, start_tracks, update


def frame_painter(params: PatchesParams, size: tuple[int, int], seed: int) -> HertzmannPainter:
    """Painter of whole frames of (width, height) px: the brush sizes of the largest regions."""
    return HertzmannPainter.of(params.style, size[0] * size[1], min(size), params, seed)


@dataclass(frozen=True)
class IndependentFrames:
    """First baseline: Hertzmann's painter, applied to each frame independently."""

    painter: HertzmannPainter
    face_detail: float = 0.0

    def __call__(self, index: int, frame: Frame) -> Frame:
        """Paint frame `index`: uint8 (h, w, 3)."""
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        return self.painter.paint_picture(frame, single_frame_planes(gray, self.face_detail))


class AdvectedFrames:
    """Second baseline: frames with advected strokes. Each run continues the strokes of the previous run."""

    def __init__(self, task: Task, context: TaskContext[PatchesParams]) -> None:
        self._context = context
        self._grid, self._begin = WorkingGrid.of(context.size), task.args["begin"]
        self._flow = WindowFlow(context, self._begin)
        self._strokes = AdvectedStrokes(frame_painter(context.params, context.size, context.seed))
        if task.after:
            self._strokes.restore(context.load("paint", task.after[0]))

    def __call__(self, index: int, frame: Frame) -> Frame:
        """Paint frame `index`, the successor of the previous call's frame: uint8 (h, w, 3)."""
        pair = self._flow.forward(index - 1) if index > self._begin else None
        if pair is None:
            return self._strokes.step(frame, index)
        flow = self._grid.enlarge(pair[0]) * np.array(self._grid.ratio, np.float32)
        occluded = self._grid.enlarge(pair[1]) < np.float32(1 / 255)
        return self._strokes.step(frame, index, flow.astype(np.float32), occluded)

    def save(self, key: str) -> None:
        """Save the strokes for the next run."""
        self._context.save(key, self._strokes.state())


class AdvectedStrokes:
    """Paints the frames of a shot in order, with strokes that are advected by optical flow."""

    def __init__(self, painter: HertzmannPainter) -> None:
        self._painter = painter
        self._layers: list[StrokeTracks] = []

    def step(self, frame: Frame, number: int, flow: Flow | None = None, occluded: Mask | None = None) -> Frame:
        """Paint the next frame: uint8 (h, w, 3).

        Args:
            number: frame number, a part of the ids of new strokes.
            flow: float32 (h, w, 2), flow from the previous frame to this one, px; None for the first frame.
            occluded: bool (h, w), pixels of the previous frame that are not visible in this one.
        """
        painter = self._painter
        canvas = blank(painter.reference(frame, painter.brush))
        previous, self._layers, tolerance = self._layers, [], error_tolerance(frame, painter.unit)
        for index in range(painter.layers):
            advected = advect(previous[index], flow, occluded) if previous and flow is not None else None
            self._layers.append(self._paint_layer(canvas, frame, index, number, advected, tolerance))
        return emboss(canvas)

    def _paint_layer(
        self, canvas: Canvas, frame: Frame, index: int, number: int, advected: StrokeTracks | None, tolerance: Plane
    ) -> StrokeTracks:  # fmt: skip
        """Update and paint the strokes of one layer, in place; returns them."""
        painter = self._painter
        brush = layer_brush(painter.brush, painter.scheme.ratio, index)
        reference, spacing = painter.reference(frame, brush), spacing_px(brush, painter.scheme)
        seeds = place(frame.shape, spacing, seed=painter.seed, layer=index, birth=number)
        limits = painter.error_limit(index, tolerance)
        if index:
            seeds = seeds[wanted(seeds, reference, canvas, brush.size_px, limits)]
        if advected is None:
            tracks = start_tracks(seeds, reference, spacing)
        else:
            keep = None
            if index:
                keep = wanted(advected.seeds, reference, canvas, brush.size_px, limits, painter.scheme.keep)
            tracks = update(advected, seeds, reference, spacing, wanted=keep)
        layer = LayerPicture.of(reference, brush)
        painter.paint_layer(canvas, tracks.seeds, layer, brush, index, tracks.targets, tracks.presence)
        return tracks

    def state(self) -> State:
        """The strokes of all layers as arrays, by name."""
        return {f"{index}-{name}": array for index, tracks in enumerate(self._layers)
                for name, array in tracks.state().items()}  # fmt: skip

    def restore(self, arrays: Arrays) -> None:
        """Restore the arrays that `state` returned."""
        self._layers = [
            StrokeTracks.from_state({
                key.removeprefix(f"{index}-"): array for key, array in arrays.items() if key.startswith(f"{index}-")
            })
            for index in range(self._painter.layers)
            if f"{index}-xy" in arrays
        ]  # fmt: skip
