"""Baseline of the method patches: strokes that are advected from frame to frame by optical flow.

An advected stroke keeps its id and thereby its jitter, bristles and painting order. It moves with the flow and follows
the picture's colour. Strokes that are crowded, occluded or no longer needed are removed; new ones are added where paint
is missing. Only past frames are used. Sources: litwinowicz1997processing, hays2004image.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.patches.compositing import frame_painter
from pipeline.methods.patches.layer_picture import LayerPicture
from pipeline.methods.patches.paint_error import error_tolerance
from pipeline.methods.patches.painter import HertzmannPainter
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import WindowFrame, flow_pair
from pipeline.strokes.brush import Canvas, blank
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import layer_brush, spacing_px, wanted
from pipeline.strokes.seeds import place
from pipeline.strokes.tracks import StrokeTracks, advect, start_tracks, update


def advected_strokes(frames: Sequence[Frame], params: PatchesParams, seed: int = 0) -> list[Frame]:
    """Paint the frames of one shot, uint8 (h, w, 3) each, with the strokes, the seeds and the flow of `patches`."""
    height, width = frames[0].shape[:2]
    grid, strokes = WorkingGrid.of((width, height)), AdvectedStrokes(frame_painter(params, (width, height), seed))
    made, before = list[Frame](), None
    for index, frame in enumerate(frames):
        now = WindowFrame.of(frame, grid)
        if before is None:
            made.append(strokes.step(frame, index))
        else:
            pair = flow_pair(before, now, 1, grid, params)
            assert pair.forward_reliability is not None
            flow = grid.upscale(pair.forward) * np.array(grid.ratio, np.float32)
            occluded = grid.upscale(pair.forward_reliability) < np.float32(1 / 255)
            made.append(strokes.step(frame, index, flow.astype(np.float32), occluded))
        before = now
    return made


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
