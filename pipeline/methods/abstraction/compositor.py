"""Compositing: regions, colours and lines become the outgoing frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour.memory import blend_colours
from pipeline.colour.paint import flat, overlay
from pipeline.frames import Flow, Frame
from pipeline.kernels.executors import FrameExecutor, Pending
from pipeline.methods.abstraction.analysis import FrameAnalysis
from pipeline.methods.abstraction.border_curves import BorderCurves
from pipeline.methods.abstraction.line_extractor import Lines
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.region_stage import ColouredRegions
from pipeline.methods.abstraction.sizes import Sizes, shrink_mask
from pipeline.methods.tasks import Clock
from pipeline.perception.backward_maps import BackwardMaps, warp_back_enlarged, warp_back_mapped
from pipeline.perception.motion import past_weights
from pipeline.regions.refinement import round_boundaries
from pipeline.regions.segmenter import Segmentation
from pipeline.vector.borders import Borders
from pipeline.vector.fill import fill_regions


@dataclass(frozen=True)
class CompositedFrame:
    """A finished frame with its intermediate results."""

    frame: Frame
    regions: Segmentation
    labels: NDArray[np.int32]
    """int32 (h, w): the labels as drawn; with `borders`, before these are smoothed."""
    colours: NDArray[np.uint8]
    """(n + 1, 3) RGB."""
    lines: Lines | None
    """None = no lines."""
    borders: Borders | None
    """The borders of `labels` as drawn; None = `labels` are drawn pixel by pixel."""
    analysis: FrameAnalysis


def ink_rgb(params: AbstractionParams) -> tuple[int, int, int]:
    """RGB of full ink, 0..255."""
    red, green, blue = bytes.fromhex(params.line_colour[1:])
    return red, green, blue


class Compositor:
    """Smooths boundaries, fills regions, draws lines over them; keeps the previous output.

    With `sizes.curves`, borders are smooth curves (`BorderCurves`), and the picture that it keeps has the blended
    colours of regions without lines, so that a line that has moved leaves no trace. Otherwise the label map is
    filtered, and the picture is the whole frame.
    """

    def __init__(self, params: AbstractionParams, sizes: Sizes, clock: Clock, background: FrameExecutor) -> None:
        self.sizes, self.clock, self.background = sizes, clock, background
        self.ink = ink_rgb(params)
        self.round_px = params.boundary_smoothing / 1000 * min(sizes.work)
        self.curves = BorderCurves(params, sizes) if sizes.curves else None
        self.picture: Frame | None = None
        self._past: Pending[Frame] | None = None

    def prepare(self, analysis: FrameAnalysis) -> None:
        """Start the work that needs no regions: warp the previous output to the current frame."""
        self._past, picture, back, flow = None, self.picture, analysis.back, analysis.flow
        if picture is None or not analysis.params.paint_memory:
            return
        if self.sizes.work != self.sizes.output:
            if flow is not None:
                self._past = self.background.submit_parallel(lambda: self._warp_enlarged(picture, flow))
        elif back is not None:
            self._past = self.background.submit_parallel(lambda: self._warp_back(picture, back))

    def _warp_back(self, picture: Frame, back: BackwardMaps) -> Frame:
        with self.clock("paint"):
            return warp_back_mapped(picture, back)

    def _warp_enlarged(self, picture: Frame, flow: Flow) -> Frame:
        with self.clock("paint"):
            return warp_back_enlarged(picture, flow)

    def step(self, coloured: ColouredRegions) -> CompositedFrame:
        """Composite a frame, after `prepare` with the analysis of the same frame."""
        with self.clock("paint"):
            return self._filtered(coloured) if self.curves is None else self._curved(coloured, self.curves)

    def _filtered(self, coloured: ColouredRegions) -> CompositedFrame:
        """The frame with a low-pass filtered label map."""
        analysis, labels = coloured.analysis, coloured.regions.labels
        if self.round_px >= 1:
            labels = round_boundaries(labels, self.round_px, self.background)
        picture = flat(labels, coloured.colours, background=self.background)
        lines = analysis.lines.result() if analysis.lines else None
        if lines is not None:
            overlay(picture, lines.coverage, self.ink, analysis.params.line_opacity, self.background)
        self.picture = self._fade(picture, analysis)
        return CompositedFrame(self.picture, coloured.regions, labels, coloured.colours, lines, None, analysis)

    def _curved(self, coloured: ColouredRegions, curves: BorderCurves) -> CompositedFrame:
        """The frame with curves as borders."""
        analysis, regions, colours = coloured.analysis, coloured.regions, coloured.colours
        labels = curves.labels(regions)
        lines = analysis.lines.result() if analysis.lines else None
        drawn = None if lines is None else shrink_mask(lines.coverage, self.sizes)
        borders = curves.borders(labels, analysis.lab, drawn)
        self.picture = self._fade(fill_regions(borders, colours, self.sizes.output, self.background), analysis)
        frame = self.picture.copy()
        if lines is not None:
            overlay(frame, lines.coverage, self.ink, analysis.params.line_opacity, self.background)
        return CompositedFrame(frame, regions, labels, colours, lines, borders, analysis)

    def _fade(self, picture: Frame, analysis: FrameAnalysis) -> Frame:
        """The picture, blended with the previous one along borders."""
        if self._past is None or analysis.residual is None:
            return picture
        past, weights = self._past.result(), past_weights(analysis.params.paint_memory * analysis.light_steadiness)
        flow = analysis.flow if self.curves else None  # soft borders may be wide
        blend_colours(picture, past, analysis.residual, flow, weights, self.background)
        return past

    def state(self) -> State:
        return {} if self.picture is None else {"picture": self.picture}

    def restore(self, state: Arrays) -> None:
        self.picture = state.get("picture")
