"""Second baseline: strokes advected from frame to frame by optical flow.

A stroke keeps its id and thereby its jitter, bristles and painting order. It moves with the flow and follows the
picture's colour. Strokes that are crowded, hidden or no longer needed are removed; new ones are added where paint is
missing. Only past frames are used. Sources: litwinowicz1997processing, hays2004image.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.masking import leniency
from pipeline.strokes.brush import Canvas, blank
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import layer_brush, layer_reference, spacing_px, wanted
from pipeline.strokes.seeds import place
from pipeline.strokes.tracks import StrokeTracks, advect, start_tracks, update


class CarriedStrokes:
    """Paints the frames of a shot in order."""

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._layers: list[StrokeTracks] = []

    def step(self, frame: Frame, number: int, flow: Flow | None = None, hidden: Mask | None = None) -> Frame:
        """Paint the next frame: uint8 (h, w, 3).

        Args:
            number: frame number, a part of the ids of new strokes.
            flow: float32 (h, w, 2), flow from the previous frame to this one, px; None for the first frame.
            hidden: bool (h, w), pixels of the previous frame that are not visible in this one.
        """
        painter = self._painter
        canvas = blank(layer_reference(frame, painter.brush, painter.scheme))
        before, self._layers, lenient = self._layers, [], leniency(frame, painter.unit)
        for index in range(painter.layers):
            old = advect(before[index], flow, hidden) if before and flow is not None else None
            self._layers.append(self._layer(canvas, frame, index, number, old, lenient))
        return emboss(canvas)

    def _layer(
        self, canvas: Canvas, frame: Frame, index: int, number: int, old: StrokeTracks | None, lenient: Plane
    ) -> StrokeTracks:  # fmt: skip
        painter = self._painter
        fine = layer_brush(painter.brush, painter.scheme.ratio, index)
        reference, spacing = layer_reference(frame, fine, painter.scheme), spacing_px(fine, painter.scheme)
        seeds = place(frame.shape, spacing, seed=painter.seed, layer=index, birth=number)
        limits = painter.limit(index, lenient)
        if index:
            seeds = seeds[wanted(seeds, reference, canvas, fine.size_px, limits)]
        if old is None:
            tracks = start_tracks(seeds, reference, spacing)
        else:
            keep = None
            if index:
                keep = wanted(old.seeds, reference, canvas, fine.size_px, limits, painter.scheme.keep)
            tracks = update(old, seeds, reference, spacing, wanted=keep)
        painter.layer(canvas, tracks.seeds, reference, fine, index, tracks.targets, tracks.presence)
        return tracks

    def state(self) -> dict[str, NDArray[Any]]:
        """The strokes of all layers as arrays, by name."""
        return {f"{index}-{name}": array for index, tracks in enumerate(self._layers)
                for name, array in tracks.state().items()}  # fmt: skip

    def restore(self, kept: dict[str, NDArray[Any]]) -> None:
        """Restore the arrays that `state` returned."""
        self._layers = [
            StrokeTracks.from_state({
                key.removeprefix(f"{index}-"): array for key, array in kept.items() if key.startswith(f"{index}-")
            })
            for index in range(self._painter.layers)
            if f"{index}-xy" in kept
        ]  # fmt: skip
