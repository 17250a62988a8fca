"""Coherent segmentation of a stream (zhang2011online, section 4), whose state can be saved and restored."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.colour.lab8 import Lab8
from pipeline.frames import Flow, Labels, Plane
from pipeline.kernels.executors import Pending
from pipeline.perception.motion import FAR
from pipeline.regions.growing import count_open, grow, unlabelled
from pipeline.regions.propagation import PreviousRegions, PropagationLimits
from pipeline.regions.refinement import add_regions
from pipeline.regions.regions import AREA, NOT_PROPAGATED, Means, Sums, means_of, measure
from pipeline.regions.segment_frame import FILLING, append_rows, fill_remaining, finalize_regions, propagate_regions
from pipeline.regions.trapped_ball import SMALL_RADIUS_PX, fill, radii

NO_AREAS = np.zeros(1, np.int32)
CHANGED = 5.0
"""Residual from which a pixel is compared with the previous colour of its region, CIELAB units."""


@dataclass(frozen=True)
class SegmenterParams:
    """Parameters of the segmentation. Colour differences are in CIELAB units.

    Attributes:
        flow_error_limit: T_f, largest difference of a pixel to its source for a label to be propagated.
        growing_limit: the 20 in 20 (1.2 - I(p)), largest difference of a pixel to its region's mean.
        misfit_slack: a propagated pixel leaves its region beyond this multiple of the growing limit.
        core_slack: a pixel leaves a new region beyond this multiple of the growing limit.
        boundary_margin: a boundary pixel changes region if the other one fits better by more than this.
        merge_similar: a region joins a larger neighbour whose mean colour is nearer than this.
        smallest_region: area below which a region is merged, share of the frame at importance 0; a fifth of it at
            importance 1.
        distinct: a region whose mean colour differs by more from that of every neighbour may be smaller.
    """

    flow_error_limit: float
    growing_limit: float
    misfit_slack: float
    core_slack: float
    boundary_margin: float
    merge_similar: float
    smallest_region: float
    distinct: float

    def in_contrast(self, contrast: float) -> SegmenterParams:
        """These parameters for a shot in which colours differ `contrast` times as much as usual, 0..1."""
        if contrast == 1:
            return self
        return replace(
            self, growing_limit=contrast * self.growing_limit, boundary_margin=contrast * self.boundary_margin,
            merge_similar=contrast * self.merge_similar, distinct=contrast * self.distinct,
        )  # fmt: skip


@dataclass(frozen=True)
class Segmentation:
    """Regions of one frame. Tables have one row per label; row 0 is unused, since every pixel has a label.

    Attributes:
        labels: int32 (h, w), 1..n, dense.
        ids: int64 (n + 1,), permanent ids: a region keeps its id from frame to frame, and ids are never reused.
        areas: int32 (n + 1,), px.
        means: float32 (n + 1, 3), mean 8-bit Lab.
        previous: int32 (n + 1,), label in the previous frame; 0 = the region is new.
        alpha: float32 (n + 1,), alpha of equation 4: pixels kept / sqrt(area before * area now); 0 = new.
        residual: number of pixels that propagation left unlabelled; all pixels at a cut.
        propagated: int32 (h, w), labels of the previous frame moved to this one, 0 = none; `NOT_PROPAGATED` at a cut.
    """

    labels: Labels
    ids: NDArray[np.int64]
    areas: NDArray[np.int32]
    means: Means
    previous: NDArray[np.int32]
    alpha: NDArray[np.float32]
    residual: int
    propagated: Labels


class Segmenter:
    """Segments consecutive frames; each result depends on earlier frames only."""

    def __init__(self, params: SegmenterParams, size: tuple[int, int], first_id: int = 1) -> None:
        self.params = params
        self.scaled = params
        self.next_id = first_id
        self.shape = (size[1], size[0])
        self.last: Segmentation | None = None
        self.remainder = np.zeros((*self.shape, 2), np.int8)

    def reset(self, first_id: int) -> None:
        """Start a shot: the next frame is segmented without its past, with ids from `first_id` on."""
        self.last = None
        self.remainder = np.zeros_like(self.remainder)
        self.next_id = first_id

    def step(
        self, lab: Lab8, edges: Pending[NDArray[np.uint8]], importance: Plane, flow: Flow | None,
        residual: NDArray[np.uint8] | None,
        fading: bool = False, contrast: float = 1.0,
    ) -> Segmentation:  # fmt: skip
        """Segment a frame.

        Args:
            lab: uint8 (h, w, 3).
            edges: uint8 (h, w), non-zero on edges; waited for only after propagation.
            importance: float32, any size, 0..1.
            flow: previous to current frame, or None for the first frame.
            residual: uint8 (h, w), CIELAB difference of every pixel to its past, quarter units; with `flow`.
            fading: whether the light changes fast. Pixels are then compared with their region as strictly as in a new
                region, and new regions are filled before old ones grow: a fade-in reveals many regions in what was
                one black region.
            contrast: how much colours differ relative to a usual shot, 0..1.
        """
        self.scaled = self.params.in_contrast(contrast)
        limit = self._limit(importance)
        known = self.last
        if known is None or flow is None or residual is None:
            labels, propagated = np.zeros(self.shape, np.int32), NOT_PROPAGATED
            sums = measure(labels, lab, limit, 0)
        else:
            previous = PreviousRegions(known.labels, known.means, flow, self.remainder, residual)
            slack = self.params.core_slack if fading else self.params.misfit_slack
            changed = float(FAR) if fading else CHANGED
            limits = PropagationLimits(self.params.flow_error_limit, self.scaled.boundary_margin, slack, changed)
            propagated, self.remainder, labels, sums = propagate_regions(previous, lab, limit, limits)
        left = int(sums[0, AREA])
        if left:
            sums = self._complete(labels, lab, edges.result(), limit, sums, grow_first=not fading)
        return self._finish(labels, propagated, sums, left, fading)

    def _limit(self, importance: Plane) -> NDArray[np.uint8]:
        """20 (1.2 - I(p)), uint8 (h, w), CIELAB units."""
        scale = self.scaled.growing_limit
        limit = cv2.convertScaleAbs(importance, alpha=-scale, beta=1.2 * scale)
        return np.asarray(limit if limit.shape == self.shape else cv2.resize(limit, self.shape[::-1]), np.uint8)

    def _complete(
        self, labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
        grow_first: bool,
    ) -> Sums:  # fmt: skip
        """Label all pixels: grow regions, fill with trapped balls, grow again, and assign the rest to the best
        neighbour."""
        pixels = unlabelled(labels)
        if len(sums) > 1 and grow_first:
            pixels = grow(labels, lab, edges, limit, sums, pixels, FILLING.first_growth)
        rolling = radii(count_open(pixels, edges))
        for radius in (r for r in rolling if r > SMALL_RADIUS_PX):
            known = len(sums)
            sums = self._roll_large(labels, lab, edges, limit, sums, pixels, radius)
            if len(sums) > known:
                pixels = grow(labels, lab, edges, limit, sums, pixels, FILLING.first_growth)
        small = next(r for r in rolling if r <= SMALL_RADIUS_PX)
        sums, pixels = fill_remaining(labels, lab, edges, limit, sums, pixels, small, self.params.core_slack)
        if not sums[1:, AREA].any():  # the frame consists of edges: one new region
            labels[:] = len(sums)
            return measure(labels, lab, limit, len(sums))
        grow(labels, lab, edges, limit, sums, pixels, np.inf)
        return sums

    def _roll_large(
        self, labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
        pixels: NDArray[np.int32], radius: int,
    ) -> Sums:  # fmt: skip
        """Fill with one large ball radius, repeatedly while pixels are released; `fill_remaining` does the smaller
        ones.

        Departure: trapped-ball filling alone makes one region of a sky from zenith to horizon, and growing then adds
        all that is within 20 units of its mean. Here pixels that differ from the mean of their new region by more than
        `core_slack` times the growing limit are released before growing and filled again: a gradient becomes bands,
        and an arm is separated from a wall.
        """
        for _ in range(FILLING.max_rolls):
            made = fill(labels, edges, pixels, radius, len(sums))
            if not made:
                break
            first_new = len(sums)
            sums = append_rows(sums, made)
            if (
                add_regions(labels, lab, limit, sums, pixels, first_new, self.params.core_slack)
                < FILLING.min_released_share * labels.size
            ):
                break
        return sums

    def _finish(
        self, labels: Labels, propagated: Labels, sums: Sums, residual: int, fading: bool
    ) -> Segmentation:  # fmt: skip
        """Merge small and similar regions, give ids, and match the regions of the previous frame.

        In a fade, only new regions are merged because they are alike: in the dark, all colours are.
        """
        known = self.last
        first_new, areas_before = (1, NO_AREAS) if known is None else (len(known.ids), known.areas)
        sums, previous, alpha = finalize_regions(
            labels, propagated, sums, (first_new, first_new if fading else 1), areas_before,
            self.scaled.growing_limit, self.scaled.smallest_region * labels.size,
            (self.scaled.merge_similar, self.scaled.distinct),
        )  # fmt: skip
        areas = sums[:, AREA].astype(np.int32)
        self.last = Segmentation(
            labels, self._ids(previous), areas, means_of(sums), previous, alpha, residual, propagated
        )
        return self.last

    def _ids(self, previous: NDArray[np.int32]) -> NDArray[np.int64]:
        ids = np.zeros(len(previous), np.int64) if self.last is None else self.last.ids[previous]
        new = np.flatnonzero(previous == 0)[1:]
        ids[new] = self.next_id + np.arange(len(new))
        self.next_id += len(new)
        return ids

    def state(self) -> State:
        """State as arrays by name; a segmenter restored from it continues with the same bytes."""
        if self.last is None:
            return {"next_id": np.array(self.next_id)}
        last = self.last
        return {
            "next_id": np.array(self.next_id), "labels": last.labels, "ids": last.ids, "areas": last.areas,
            "means": last.means, "remainder": self.remainder,
        }  # fmt: skip

    def restore(self, state: Arrays) -> None:
        self.next_id = int(state["next_id"])
        self.last = None
        if "labels" in state:
            self.remainder = state["remainder"]
            rows = len(state["ids"])
            self.last = Segmentation(
                state["labels"], state["ids"], state["areas"], state["means"],
                np.zeros(rows, np.int32), np.zeros(rows, np.float32), 0, NOT_PROPAGATED,
            )  # fmt: skip
