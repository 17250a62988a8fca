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
class OutlinedRegions:
    """The regions of a frame as they are drawn; see `CompositedFrame`."""

    coloured: ColouredRegions
    labels: NDArray[np.int32]
    lines: Lines | None
    borders: Borders | None


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

    def outline(self, coloured: ColouredRegions) -> OutlinedRegions:
        """Smooth the boundaries of a frame. Uses no state: it may run for the next frame while `step` fills this
        one."""
        analysis, regions = coloured.analysis, coloured.regions
        with self.clock("paint"):
            labels = self._filtered(regions) if self.curves is None else self.curves.labels(regions)
        lines = analysis.lines.result() if analysis.lines else None
        if self.curves is None:
            return OutlinedRegions(coloured, labels, lines, None)
        with self.clock("paint"):
            drawn = None if lines is None else shrink_mask(lines.coverage, self.sizes)
            return OutlinedRegions(coloured, labels, lines, self.curves.borders(labels, analysis.lab, drawn))

    def _filtered(self, regions: Segmentation) -> NDArray[np.int32]:
        """The label map, low-pass filtered."""
        rounds = self.round_px >= 1
        return round_boundaries(regions.labels, self.round_px, self.background) if rounds else regions.labels

    def step(self, outlined: OutlinedRegions) -> CompositedFrame:
        """Composite a frame, after `prepare` with the analysis of the same frame."""
        coloured, lines, borders = outlined.coloured, outlined.lines, outlined.borders
        analysis, colours = coloured.analysis, coloured.colours
        with self.clock("paint"):
            if borders is None:
                frame = flat(outlined.labels, colours, background=self.background)
                self._overlay(frame, lines, analysis)
                frame = self.picture = self._fade(frame, analysis)
            else:
                self.picture = self._fade(fill_regions(borders, colours, self.sizes.output, self.background), analysis)
                frame = self.picture.copy()
                self._overlay(frame, lines, analysis)
        return CompositedFrame(frame, coloured.regions, outlined.labels, colours, lines, borders, analysis)

    def _overlay(self, frame: Frame, lines: Lines | None, analysis: FrameAnalysis) -> None:
        if lines is not None:
            overlay(frame, lines.coverage, self.ink, analysis.params.line_opacity, self.background)

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
