"""Compositing: regions, colours and lines become the outgoing frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.background import Background, Pending
from pipeline.colour.paint import flat, overlay
from pipeline.frames import Frame
from pipeline.lines.coherent import Ink
from pipeline.lines.colour_stripes import uncover_stripes
from pipeline.methods.abstraction.analysis import FrameAnalysis
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.region_stage import ColouredRegions
from pipeline.methods.tasks import Clock
from pipeline.segmentation.backward import BackwardMaps, warp_back
from pipeline.segmentation.motion import blend_with_past
from pipeline.segmentation.refinement import round_boundaries
from pipeline.segmentation.segmenter import Segmentation
from pipeline.vector.borders import Borders

INK = (14, 11, 16)
"""RGB of full ink: a warm black."""


@dataclass(frozen=True)
class CompositedFrame:
    """A finished frame with its intermediate results."""

    frame: Frame
    regions: Segmentation
    labels: NDArray[np.int32]
    """int32 (h, w): the labels as drawn, boundaries smoothed."""
    colours: NDArray[np.uint8]
    """(n + 1, 3) RGB."""
    ink: Ink | None
    """The line layer; None = no lines."""
    borders: Borders | None = None
    """The borders of `labels` as drawn; None = `labels` are drawn pixel by pixel."""


class Compositor:
    """Smooths boundaries, fills regions, draws lines over them; keeps the previous output."""

    def __init__(self, params: AbstractionParams, size: tuple[int, int], clock: Clock, background: Background) -> None:
        self.params, self.clock, self.background = params, clock, background
        self.round_px = params.boundary_smoothing / 1000 * min(size)
        self.picture: Frame | None = None
        self._past: Pending[Frame] | None = None

    def prepare(self, analysis: FrameAnalysis) -> None:
        """Start the work that needs no regions: warp the previous output to the current frame."""
        self._past, picture, back = None, self.picture, analysis.back
        if back is not None and picture is not None and self.params.paint_memory:
            self._past = self.background.offer(lambda: self._warp_back(picture, back))

    def _warp_back(self, picture: Frame, back: BackwardMaps) -> Frame:
        with self.clock("paint"):
            return warp_back(picture, back)

    def step(self, coloured: ColouredRegions) -> CompositedFrame:
        """Composite a frame, after `prepare` with the analysis of the same frame."""
        analysis, regions, background = coloured.analysis, coloured.regions, self.background
        with self.clock("paint"):
            labels = (
                round_boundaries(regions.labels, self.round_px, background) if self.round_px >= 1 else regions.labels
            )
            picture = flat(labels, coloured.colours, background=background)
            ink = None if analysis.ink is None else analysis.ink.result()
            if ink is not None:
                ink, _ = uncover_stripes(ink, ink, regions.labels, regions.areas, regions.means)
                overlay(picture, ink, INK, self.params.line_opacity, background)
            self.picture = self._fade(picture, analysis)
        return CompositedFrame(self.picture, regions, labels, coloured.colours, ink)

    def _fade(self, picture: Frame, analysis: FrameAnalysis) -> Frame:
        """Cross-fade from the previous output where the source agrees with its past, so that regions do not pop."""
        if self._past is None or analysis.residual is None:
            return picture
        return blend_with_past(
            picture,
            self._past.result(),
            analysis.residual,
            self.params.paint_memory * analysis.light_steadiness,
            self.background,
        )

    def state(self) -> State:
        return {} if self.picture is None else {"picture": self.picture}

    def restore(self, state: Arrays) -> None:
        self.picture = state.get("picture")
