"""Segmentation and region colours of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State, flatten, part
from pipeline.colour.scheme import ColourStats
from pipeline.methods.abstraction.analysis import FrameAnalysis
from pipeline.methods.abstraction.palette import Palette
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.tasks import Clock
from pipeline.perception.cuts import CUTS
from pipeline.regions.printed import PrintedSegmenter
from pipeline.regions.segmenter import Segmentation, Segmenter, SegmenterParams

IDS_A_SHOT = 1_000_000_000
"""Region ids are shot * IDS_A_SHOT + n, which makes them unique although shots are processed independently."""


@dataclass(frozen=True)
class RegionParams:
    """Constants of regions."""

    misfit_slack: float = 1.1
    """A pixel leaves its region beyond this multiple of the growing limit; slightly more than the limit for joining."""
    distinct: float = 60.0
    """Difference of colours above which a region may be smaller than `smallest_region`: CIELAB units for each per
    mille of the frame, 12 by default. Large values of `smallest_region` leave no such regions."""


REGIONS = RegionParams()


@dataclass(frozen=True)
class ColouredRegions:
    """A frame's regions and their colours."""

    analysis: FrameAnalysis
    regions: Segmentation
    colours: NDArray[np.uint8]
    """(n + 1, 3) RGB."""


class RegionStage:
    """Segments consecutive frames and computes the colours of the regions."""

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], reference: ColourStats | None, clock: Clock
    ) -> None:  # fmt: skip
        self.clock = clock
        segmenter = PrintedSegmenter if params.algorithm == "printed" else Segmenter
        self.segmenter = segmenter(_segmenter(params.at(0)), size)
        self.palette = Palette(params, reference)
        self.shot = -1

    def step(self, analysis: FrameAnalysis) -> ColouredRegions:
        importance, params = analysis.importance.result(), analysis.params
        self.segmenter.params = self.segmenter.scaled = _segmenter(params)
        with self.clock("segment"):
            if analysis.flow is None:
                self._begin(analysis.shot)
            fading = analysis.light_steadiness < CUTS.fading
            regions = self.segmenter.step(
                analysis.lab, analysis.edges, importance, analysis.flow, analysis.residual, fading, analysis.contrast
            )
        with self.clock("colour"):
            self.palette.params = params
            colours = self.palette.step(regions, analysis.tone, analysis.light_steadiness)
        return ColouredRegions(analysis, regions, colours)

    def _begin(self, shot: int) -> None:
        """Start a shot with its own range of ids. With `temporal=off`, each frame continues the ids of its shot."""
        self.segmenter.reset(self.segmenter.next_id if shot == self.shot else shot * IDS_A_SHOT + 1)
        self.palette.reset()
        self.shot = shot

    def state(self) -> State:
        parts = {"segmenter": self.segmenter.state(), "palette": self.palette.state()}
        return {"shot": np.array(self.shot)} | flatten(parts)

    def restore(self, state: Arrays) -> None:
        self.shot = int(state["shot"])
        self.segmenter.restore(part(state, "segmenter"))
        self.palette.restore(part(state, "palette"))


def _segmenter(params: AbstractionParams) -> SegmenterParams:
    return SegmenterParams(
        flow_error_limit=params.flow_error_limit,
        growing_limit=params.growing_limit,
        misfit_slack=REGIONS.misfit_slack,
        core_slack=params.core_tolerance,
        boundary_margin=params.boundary_margin,
        merge_similar=params.merge_similar,
        smallest_region=params.smallest_region / 1000,
        distinct=REGIONS.distinct * params.smallest_region,
    )
