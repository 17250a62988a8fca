"""The second baseline: strokes carried from frame to frame by flow, as others do.

A stroke keeps its name, so its jitter, hairs and turn; it moves with the flow, follows the picture's colour, is
lifted where it crowds, is hidden or is needed no more, and new ones come where paint is missing. Nothing knows the
future. Sources: litwinowicz1997processing, hays2004image.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.patches.hertzmann import Painter
from pipeline.methods.patches.masking import leniency
from pipeline.strokes.brush import Canvas, blank
from pipeline.strokes.carry import Living, begin, carry, tend
from pipeline.strokes.emboss import Light, emboss
from pipeline.strokes.layers import layer_brush, layer_reference, spacing_px, wanted
from pipeline.strokes.seeds import Seeds, place


class CarriedStrokes:
    """Paints the frames of a shot one after the other."""

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._layers: list[Living] = []

    def step(self, frame: Frame, number: int, flow: Flow | None = None, hidden: Mask | None = None) -> Frame:
        """The next frame, painted.

        Args:
            number: of the frame, a part of the names of strokes that are born in it.
            flow: float32 (h, w, 2) from the frame before, px; None for the first one.
            hidden: bool (h, w), pixels of the frame before that this one does not show.
        """
        painter = self._painter
        canvas = blank(layer_reference(frame, painter.brush, painter.recipe))
        before, self._layers, lenient = self._layers, [], leniency(frame, painter.unit)
        for index in range(painter.layers):
            old = carry(before[index], flow, hidden) if before and flow is not None else None
            self._layers.append(self._layer(canvas, frame, index, number, old, lenient))
        return emboss(canvas, Light())

    def _layer(
        self, canvas: Canvas, frame: Frame, index: int, number: int, old: Living | None, lenient: Plane
    ) -> Living:  # fmt: skip
        painter = self._painter
        fine = layer_brush(painter.brush, painter.recipe, index)
        reference, spacing = layer_reference(frame, fine, painter.recipe), spacing_px(fine, painter.recipe)
        seeds = place(frame.shape, spacing, seed=painter.seed, layer=index, birth=number)
        limits = painter.limit(index, lenient)
        if index:
            seeds = seeds[wanted(seeds, reference, canvas, fine.size_px, limits)]
        if old is None:
            living = begin(seeds, reference, spacing)
        else:
            keep = None
            if index:
                keep = wanted(old.seeds, reference, canvas, fine.size_px, limits, painter.recipe.hold)
            living = tend(old, seeds, reference, spacing, wanted=keep)
        painter.layer(canvas, living.seeds, reference, fine, index, living.aims, living.presence)
        return living

    def state(self) -> dict[str, NDArray[Any]]:
        """All that is remembered, as arrays."""
        kept: dict[str, NDArray[Any]] = {}
        for index, living in enumerate(self._layers):
            kept |= {
                f"{index}-xy": living.seeds.xy, f"{index}-ids": living.seeds.ids, f"{index}-aims": living.aims,
                f"{index}-presence": living.presence, f"{index}-leaving": living.leaving, f"{index}-born": living.born,
            }  # fmt: skip
        return kept

    def restore(self, kept: dict[str, NDArray[Any]]) -> None:
        """Go on from a `state`."""
        self._layers = [
            Living(
                Seeds(kept[f"{index}-xy"], kept[f"{index}-ids"].astype(np.uint64)),
                kept[f"{index}-aims"],
                kept[f"{index}-presence"],
                kept[f"{index}-leaving"].astype(np.bool_),
                kept[f"{index}-born"],
            )
            for index in range(self._painter.layers)
            if f"{index}-xy" in kept
        ]
