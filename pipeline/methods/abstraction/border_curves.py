"""Region borders as smooth curves, which are filled by exact pixel coverage (`edges=sharp`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.lines.pen import Ink
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import Sizes, analysis_blur_px
from pipeline.regions.ramps import divide_ramps
from pipeline.regions.segmenter import Segmentation
from pipeline.vector.borders import Borders, find_borders, hide_borders_under_lines
from pipeline.vector.simplify import simplify_borders
from pipeline.vector.smoothing import smooth_borders


@dataclass(frozen=True)
class CurveParams:
    """Constants of the smoothing of borders."""

    sigma_share: float = 0.75
    limit_share: float = 0.67
    """Standard deviation of the border smoothing, and the largest displacement of a border, as shares of the radius
    `boundary_smoothing`."""
    least_sigma_px: float = 1.2
    """Smallest standard deviation when the picture is larger than the label map: enough to hide the label map's
    pixels."""
    least_limit_px: float = 0.75
    """Smallest displacement limit: enough to straighten the steps of a slanting border."""
    least_reach_px: int = 2
    """Smallest distance, px of the label map, from which a border is moved under a line: a slanting border has
    steps."""
    simple_sigma_share: float = 3.0
    simple_limit_share: float = 2.5
    """The same for borders through shading, where the picture has no edge (`simplify_borders`)."""
    most_sigma_px: float = 20.0
    """Largest standard deviation of that smoothing, px: its cost grows with the square."""
    contrast_share: float = 1 / 180
    """Distance at which the colours on both sides of a border are compared, as a share of the frame's shorter side."""
    ramp_sigmas: float = 3.5
    """Extent of the thin regions that are divided (`divide_ramps`), in standard deviations of the blur before
    analysis."""


CURVES = CurveParams()


class BorderCurves:
    """Finds and smooths the borders of regions."""

    def __init__(self, params: AbstractionParams, sizes: Sizes) -> None:
        radius_px = params.boundary_smoothing / 1000 * min(sizes.work)
        self.sigma_px = CURVES.sigma_share * radius_px
        if sizes.work != sizes.output:
            self.sigma_px = max(CURVES.least_sigma_px, self.sigma_px)
        self.widest_ramp_px = round(CURVES.ramp_sigmas * analysis_blur_px(sizes))
        self.limit_px = max(CURVES.least_limit_px, CURVES.limit_share * radius_px)
        self.reach_px = max(CURVES.least_reach_px, round(CURVES.contrast_share * min(sizes.work)))
        self.simple_sigma_px = min(CURVES.simple_sigma_share * radius_px, CURVES.most_sigma_px)
        self.simple_limit_px = CURVES.simple_limit_share * radius_px

    def labels(self, regions: Segmentation) -> Labels:
        """The label map whose borders are drawn: blurred edges of the frame are divided."""
        return divide_ramps(regions.labels, regions.means, self.widest_ramp_px)

    def borders(self, labels: Labels, lab: Lab8, drawn: Ink | None) -> Borders:
        """The smooth borders of `labels`. Those near a line of `drawn`, ink at the size of the labels, lie under it."""
        borders = find_borders(labels)
        if drawn is not None:
            borders = hide_borders_under_lines(
                borders, labels, drawn, max(CURVES.least_reach_px, math.ceil(self.limit_px))
            )
        borders = smooth_borders(borders, self.sigma_px, self.limit_px)
        if not self.simple_sigma_px:
            return borders
        return simplify_borders(borders, lab, self.reach_px, self.simple_sigma_px, self.simple_limit_px)
