"""Compositing of `edges=sharp`: region borders are smooth curves, filled by exact pixel coverage."""

from __future__ import annotations

import math

from pipeline.background import Background
from pipeline.colour.fast_borders import steepen_fast_borders
from pipeline.colour.memory import blend_colours, moving_borders
from pipeline.colour.paint import overlay
from pipeline.frames import Flow, Frame, Labels
from pipeline.lines.coherent import Ink
from pipeline.lines.colour_stripes import uncover_stripes
from pipeline.methods.abstraction.analysis import FrameAnalysis
from pipeline.methods.abstraction.compositor import INK, CompositedFrame, Compositor
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.region_stage import ColouredRegions
from pipeline.methods.abstraction.sizes import Sizes, analysis_blur_px, shrink_mask
from pipeline.methods.tasks import Clock
from pipeline.segmentation.backward import warp_enlarged
from pipeline.segmentation.motion import closed_residual, past_weights
from pipeline.segmentation.ramps import divide_ramps
from pipeline.segmentation.segmenter import Segmentation
from pipeline.vector.borders import Borders, align_borders, find_borders, tuck_borders
from pipeline.vector.fill import fill_regions
from pipeline.vector.simplify import simplify_borders
from pipeline.vector.smoothing import smooth_borders

SIGMA_SHARE, LIMIT_SHARE = 0.75, 0.67
"""Standard deviation of the border smoothing, and the largest displacement of a border, as shares of the radius
`boundary_smoothing`."""
LEAST_SIGMA_PX = 1.2
"""Smallest standard deviation when the picture is larger than the label map: enough to hide the label map's pixels."""
LEAST_LIMIT_PX = 0.75
"""Smallest displacement limit: enough to straighten the steps of a slanting border."""
LEAST_REACH_PX = 2
"""Smallest distance, px of the label map, from which a border is moved under a line: a slanting border has steps."""
SIMPLE_SIGMA_SHARE, SIMPLE_LIMIT_SHARE = 3.0, 2.5
"""The same for borders through shading, where the picture has no edge (`simplify_borders`)."""
MOST_SIGMA_PX = 20.0
"""Largest standard deviation of that smoothing, px: its cost grows with the square."""
CONTRAST_SHARE = 1 / 180
"""Distance at which the colours on both sides of a border are compared, as a share of the frame's shorter side."""
RAMP_SIGMAS = 3.5
"""Extent of the thin regions that are divided (`divide_ramps`), in standard deviations of the blur before analysis."""


class SharpCompositor(Compositor):
    """Smooths borders, fills regions and draws lines over them.

    The picture that it keeps, `picture`, has the blended region colours without lines, so that a line that has moved
    leaves no trace. `CompositedFrame.labels` are the labels before borders are smoothed.
    """

    def __init__(self, params: AbstractionParams, sizes: Sizes, clock: Clock, background: Background) -> None:
        super().__init__(params, sizes.work, clock, background)
        self.sizes = sizes
        radius_px = params.boundary_smoothing / 1000 * min(sizes.work)
        self.sigma_px = SIGMA_SHARE * radius_px
        if sizes.work != sizes.output:
            self.sigma_px = max(LEAST_SIGMA_PX, self.sigma_px)
        self.widest_ramp_px = round(RAMP_SIGMAS * analysis_blur_px(sizes))
        self.limit_px = max(LEAST_LIMIT_PX, LIMIT_SHARE * radius_px)
        self.reach_px = max(LEAST_REACH_PX, round(CONTRAST_SHARE * min(sizes.work)))
        self.simple_sigma_px = min(SIMPLE_SIGMA_SHARE * radius_px, MOST_SIGMA_PX)
        self.simple_limit_px = SIMPLE_LIMIT_SHARE * radius_px

    def prepare(self, analysis: FrameAnalysis) -> None:
        """Start the work that needs no regions: warp the previous output to the current frame."""
        if self.sizes.work == self.sizes.output:
            super().prepare(analysis)
            return
        self._past, picture, flow = None, self.picture, analysis.flow
        if flow is not None and picture is not None and self.params.paint_memory:
            self._past = self.background.offer(lambda: self._warp_enlarged(picture, flow))

    def _warp_enlarged(self, picture: Frame, flow: Flow) -> Frame:
        with self.clock("paint"):
            return warp_enlarged(picture, flow)

    def step(self, coloured: ColouredRegions) -> CompositedFrame:
        """Composite a frame, after `prepare` with the analysis of the same frame."""
        analysis, regions, colours = coloured.analysis, coloured.regions, coloured.colours
        with self.clock("paint"):
            labels = divide_ramps(regions.labels, regions.means, self.widest_ramp_px)
            ink, drawn = (None, None) if analysis.ink is None else self._ink(analysis.ink.result(), regions)
            borders = self._borders(labels, analysis, drawn)
            flat = fill_regions(borders, colours, self.sizes.output, self.background)
            self.picture = self._blend(flat, labels, analysis)
            frame = self.picture.copy()
            if ink is not None:
                overlay(frame, ink, INK, self.params.line_opacity, self.background)
        return CompositedFrame(frame, regions, labels, colours, ink, borders)

    def _ink(self, ink: Ink, regions: Segmentation) -> tuple[Ink, Ink]:
        """The ink without that on thin coloured regions, and the same at the size of the labels."""
        drawn = shrink_mask(ink, self.sizes)
        return uncover_stripes(ink, drawn, regions.labels, regions.areas, regions.means)

    def _borders(self, labels: Labels, analysis: FrameAnalysis, drawn: Ink | None) -> Borders:
        borders = find_borders(labels)
        if analysis.flow is not None:
            borders = align_borders(borders, labels, analysis.lab, analysis.flow)
        if drawn is not None:
            borders = tuck_borders(borders, labels, drawn, max(LEAST_REACH_PX, math.ceil(self.limit_px)))
        borders = smooth_borders(borders, self.sigma_px, self.limit_px)
        if not self.simple_sigma_px:
            return borders
        return simplify_borders(borders, analysis.lab, self.reach_px, self.simple_sigma_px, self.simple_limit_px)

    def _blend(self, picture: Frame, labels: Labels, analysis: FrameAnalysis) -> Frame:
        """Cross-fade from the previous colours where the source agrees with its past, so that regions do not pop."""
        if self._past is None or analysis.residual is None or analysis.flow is None:
            return picture
        weights = past_weights(self.params.paint_memory * analysis.light_steadiness)
        past = self._past.result()
        moving = moving_borders(labels, analysis.flow)
        blend_colours(picture, past, closed_residual(analysis.residual), weights, moving, self.background)
        steepen_fast_borders(past, moving)
        return past
