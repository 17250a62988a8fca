"""Coherent segmentation of a stream: zhang2011online, section 4, with a state that can be handed on."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.background import Pending
from pipeline.frames import Flow, Labels, Plane
from pipeline.segmentation.growing import count_open, grow, unlabelled
from pipeline.segmentation.passes import CORE_ROLLS, WORTH_A_ROLL, carry_over, fill_up, name_regions, with_room
from pipeline.segmentation.refinement import adopt
from pipeline.segmentation.regions import AREA, NOTHING_CARRIED, Lab8, Means, Sums, means_of, measure
from pipeline.segmentation.trapped_ball import TAPPED_UP_TO_PX, fill, radii

NO_AREAS = np.zeros(1, np.int32)


@dataclass(frozen=True)
class SegmenterParams:
    flow_error_limit: float
    """T_f, CIELAB units."""
    growing_limit: float
    """20 in 20 (1.2 - I(p)), CIELAB units."""
    misfit_slack: float
    core_slack: float
    boundary_margin: float
    """CIELAB units."""
    merge_similar: float
    """CIELAB units."""
    smallest_region: float
    """Share of the frame, 0..1, at importance 0; a fifth of it at importance 1."""


@dataclass(frozen=True)
class Segmentation:
    """One frame's regions. Rows of the tables are labels; row 0 is unused, as no pixel is unlabelled."""

    labels: Labels
    """int32 (h, w), 1..n, dense."""
    ids: NDArray[np.int64]
    """(n + 1,): names that a region keeps for life and no other region gets."""
    areas: NDArray[np.int32]
    means: Means
    """8-bit Lab."""
    previous: NDArray[np.int32]
    """(n + 1,): the region's label in the previous frame, 0 = new."""
    alpha: NDArray[np.float32]
    """(n + 1,): eq. 4's alpha: pixels carried over / sqrt(area before * area now), 0 = new."""
    residual: int
    """Pixels the propagation left unlabelled: the whole frame at a cut."""


class Segmenter:
    """Segments frame after frame; each call depends on the frames before only."""

    def __init__(self, params: SegmenterParams, size: tuple[int, int], first_id: int = 1) -> None:
        self.params = params
        self.next_id = first_id
        self.shape = (size[1], size[0])
        self.last: Segmentation | None = None
        self.remainder = np.zeros((*self.shape, 2), np.int8)

    def reset(self, first_id: int) -> None:
        """Forget the past: the next frame is segmented afresh, with ids from `first_id` on."""
        self.last = None
        self.remainder = np.zeros_like(self.remainder)
        self.next_id = first_id

    def step(
        self, lab: Lab8, edges: Pending[NDArray[np.uint8]], importance: Plane, flow: Flow | None,
        residual: NDArray[np.uint8] | None,
        fading: bool = False,
    ) -> Segmentation:  # fmt: skip
        """Segment a frame.

        Args:
            lab: uint8 (h, w, 3).
            edges: uint8 (h, w), non-zero on edges; waited for only when regions have been carried over.
            importance: float32, any size, 0..1.
            flow: previous to current frame, or None for the first frame.
            residual: uint8 (h, w), CIELAB difference of every pixel to its past, quarter units; with `flow`.
            fading: the light is changing fast. Regions then have to earn their pixels anew: misfits are judged as
                strictly as in a new region, and balls roll before regions grow (what a fade-in reveals was one
                black region before).
        """
        limit = self._limit(importance)
        known = self.last
        if known is None or flow is None or residual is None:
            labels, carried = np.zeros(self.shape, np.int32), NOTHING_CARRIED
            sums = measure(labels, lab, limit, 0)
        else:
            carried, self.remainder, labels, sums = carry_over(
                known.labels, lab, limit, flow, self.remainder, residual, len(known.ids) - 1,
                self.params.flow_error_limit, self.params.boundary_margin,
                self.params.core_slack if fading else self.params.misfit_slack,
            )  # fmt: skip
        left = int(sums[0, AREA])
        if left:
            sums = self._complete(labels, lab, edges.result(), limit, sums, grow_first=not fading)
        return self._finish(labels, carried, sums, left)

    def _limit(self, importance: Plane) -> NDArray[np.uint8]:
        """20 (1.2 - I(p)), uint8 (h, w), CIELAB units."""
        scale = self.params.growing_limit
        limit = cv2.convertScaleAbs(importance, alpha=-scale, beta=1.2 * scale)
        return np.asarray(limit if limit.shape == self.shape else cv2.resize(limit, self.shape[::-1]), np.uint8)

    def _complete(
        self, labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
        grow_first: bool,
    ) -> Sums:  # fmt: skip
        """Grow, roll balls, grow again, and let leftovers join their best neighbour: no pixel stays unlabelled."""
        pixels = unlabelled(labels)
        if len(sums) > 1 and grow_first:
            pixels = grow(labels, lab, edges, limit, sums, pixels)
        rolling = radii(count_open(pixels, edges))
        for radius in (r for r in rolling if r > TAPPED_UP_TO_PX):
            known = len(sums)
            sums = self._roll_large(labels, lab, edges, limit, sums, pixels, radius)
            if len(sums) > known:
                pixels = grow(labels, lab, edges, limit, sums, pixels)
        small = next(r for r in rolling if r <= TAPPED_UP_TO_PX)
        sums, pixels = fill_up(labels, lab, edges, limit, sums, pixels, small, self.params.core_slack)
        if not sums[1:, AREA].any():  # nothing but edges: one new region
            labels[:] = len(sums)
            return measure(labels, lab, limit, len(sums))
        grow(labels, lab, edges, limit, sums, pixels, True)
        return sums

    def _roll_large(
        self, labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
        pixels: NDArray[np.int32], radius: int,
    ) -> Sums:  # fmt: skip
        """Roll one ball, and again where it found more than one colour; smaller ones roll in `fill_up`.

        Departure: a ball alone makes one region of a sky from zenith to horizon, and growing then takes in all that is
        within 20 units of its mean. What is further than `core_slack` of that from a new region's mean is set free
        again before growing, to be found by the next roll: a gradient becomes bands, an arm parts from a wall.
        """
        for _ in range(CORE_ROLLS):
            made = fill(labels, edges, pixels, radius, len(sums))
            if not made:
                break
            born_from = len(sums)
            sums = with_room(sums, made)
            if adopt(labels, lab, limit, sums, pixels, born_from, self.params.core_slack) < WORTH_A_ROLL * labels.size:
                break
        return sums

    def _finish(
        self, labels: Labels, carried: Labels, sums: Sums, residual: int
    ) -> Segmentation:  # fmt: skip
        """Merge specks and look-alikes, name regions, and say how each relates to the previous frame."""
        known = self.last
        sums, previous, alpha = name_regions(
            labels, carried, sums, 1 if known is None else len(known.ids), NO_AREAS if known is None else known.areas,
            self.params.growing_limit, self.params.smallest_region * labels.size, self.params.merge_similar,
        )  # fmt: skip
        areas = sums[:, AREA].astype(np.int32)
        self.last = Segmentation(labels, self._ids(previous), areas, means_of(sums), previous, alpha, residual)
        return self.last

    def _ids(self, previous: NDArray[np.int32]) -> NDArray[np.int64]:
        ids = np.zeros(len(previous), np.int64) if self.last is None else self.last.ids[previous]
        new = np.flatnonzero(previous == 0)[1:]
        ids[new] = self.next_id + np.arange(len(new))
        self.next_id += len(new)
        return ids

    def state(self) -> State:
        """All it remembers, for `restore`: a restored segmenter goes on with the same bytes."""
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
                np.zeros(rows, np.int32), np.zeros(rows, np.float32), 0,
            )  # fmt: skip
