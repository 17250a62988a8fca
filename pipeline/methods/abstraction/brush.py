"""The brush: regions, colours and ink to the outgoing frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.aside import Aside, Later
from pipeline.colour.paint import flat, overlay
from pipeline.frames import Frame
from pipeline.lines.coherent import Ink
from pipeline.methods.abstraction.eye import Percept
from pipeline.methods.abstraction.hand import Sketch
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.state import Clock, State
from pipeline.segmentation.motion import WayBack, bring, fade
from pipeline.segmentation.segmenter import Segmentation
from pipeline.segmentation.tidy import round_boundaries

INK = (14, 11, 16)
"""RGB of full ink: a warm black."""


@dataclass(frozen=True)
class Painting:
    """A finished frame with what it was made from."""

    frame: Frame
    regions: Segmentation
    labels: NDArray[np.int32]
    """int32 (h, w): the labels as drawn, boundaries smoothed."""
    colours: NDArray[np.uint8]
    """(n + 1, 3) RGB."""
    ink: Ink | None
    """The line layer; None = no lines."""


class Brush:
    """Smooths boundaries, fills regions, lays ink over them; remembers the last frame's paint."""

    def __init__(self, params: AbstractionParams, size: tuple[int, int], clock: Clock, aside: Aside) -> None:
        self.params, self.clock, self.aside = params, clock, aside
        self.round_px = params.boundary_smoothing / 1000 * size[1]
        self.picture: Frame | None = None
        self._past: Later[Frame] | None = None

    def expect(self, percept: Percept) -> None:
        """Begin with what needs no regions: the last frame's paint is moved to where it is now."""
        self._past, picture, back = None, self.picture, percept.back
        if back is not None and picture is not None and self.params.paint_memory:
            self._past = self.aside.offer(lambda: self._bring(picture, back))

    def _bring(self, picture: Frame, back: WayBack) -> Frame:
        with self.clock("paint"):
            return bring(picture, back)

    def step(self, sketch: Sketch) -> Painting:
        """After `expect` of the same frame."""
        percept, regions, aside = sketch.percept, sketch.regions, self.aside
        with self.clock("paint"):
            labels = round_boundaries(regions.labels, self.round_px, aside) if self.round_px >= 1 else regions.labels
            picture = flat(labels, sketch.colours, aside=aside)
            ink = None if percept.ink is None else percept.ink.result()
            if ink is not None:
                overlay(picture, ink, INK, self.params.line_opacity, aside)
            self.picture = self._fade(picture, percept)
        return Painting(self.picture, regions, labels, sketch.colours, ink)

    def _fade(self, picture: Frame, percept: Percept) -> Frame:
        """Where the source agrees with its past, let paint fade over from the last frame rather than jump."""
        if self._past is None or percept.residual is None:
            return picture
        return fade(picture, self._past.result(), percept.residual, self.params.paint_memory * percept.calm, self.aside)

    def state(self) -> State:
        return {} if self.picture is None else {"picture": self.picture}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.picture = state.get("picture")
