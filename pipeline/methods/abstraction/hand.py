"""The hand: which pixels belong together, and what colour they get."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.scheme import ColourStats
from pipeline.methods.abstraction.eye import Percept
from pipeline.methods.abstraction.palette import Palette
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.state import Clock, State, flatten, part
from pipeline.segmentation.segmenter import Segmentation, Segmenter, SegmenterParams

IDS_A_SHOT = 1_000_000_000
"""Region ids are shot * IDS_A_SHOT + n: unique over the video although shots are done apart."""
FADING = 0.15
"""`calm` below which regions have to earn their pixels anew."""
MISFIT_SLACK = 1.1
"""A pixel leaves its region beyond this share of the growing limit: a little more than it took to join."""


@dataclass(frozen=True)
class Sketch:
    """A frame's regions and their colours."""

    percept: Percept
    regions: Segmentation
    colours: NDArray[np.uint8]
    """(n + 1, 3) RGB."""


class Hand:
    """Segments, and colours regions."""

    def __init__(
        self, params: AbstractionParams, size: tuple[int, int], reference: ColourStats | None, clock: Clock
    ) -> None:  # fmt: skip
        self.params, self.clock = params, clock
        self.segmenter = Segmenter(_segmenter(params), size)
        self.palette = Palette(params, reference)
        self.shot = -1

    def step(self, percept: Percept) -> Sketch:
        importance = percept.importance.result()
        with self.clock("segment"):
            if percept.flow is None:
                self._begin(percept.shot)
            fading = percept.calm < FADING
            regions = self.segmenter.step(
                percept.lab, percept.edges, importance, percept.flow, percept.residual, fading
            )
        with self.clock("colour"):
            colours = self.palette.step(regions, percept.tone, percept.calm)
        return Sketch(percept, regions, colours)

    def _begin(self, shot: int) -> None:
        """A shot's ids start at its own base; frames on their own (`temporal=off`) go on counting within it."""
        self.segmenter.reset(self.segmenter.next_id if shot == self.shot else shot * IDS_A_SHOT + 1)
        self.palette.last = None
        self.shot = shot

    def state(self) -> State:
        parts = {"segmenter": self.segmenter.state(), "palette": self.palette.state()}
        return {"shot": np.array(self.shot)} | flatten(parts)

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.shot = int(state["shot"])
        self.segmenter.restore(part(state, "segmenter"))
        self.palette.restore(part(state, "palette"))


def _segmenter(params: AbstractionParams) -> SegmenterParams:
    return SegmenterParams(
        flow_error_limit=params.flow_error_limit,
        growing_limit=params.growing_limit,
        misfit_slack=MISFIT_SLACK,
        core_slack=params.core_tolerance,
        boundary_margin=params.boundary_margin,
        merge_similar=params.merge_similar,
        smallest_region=params.smallest_region / 1000,
    )
