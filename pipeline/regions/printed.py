"""The segmentation of zhang2011online as printed (algorithm 1, sections 4.2 to 4.4), for comparison."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Flow, Labels, Plane
from pipeline.kernels.executors import Pending
from pipeline.regions.growing import grow, unlabelled
from pipeline.regions.propagation import propagate, smooth_labels
from pipeline.regions.refinement import add_regions
from pipeline.regions.regions import AREA, NOT_PROPAGATED, Sums, measure
from pipeline.regions.segment_frame import append_rows
from pipeline.regions.segmenter import Segmentation, Segmenter
from pipeline.regions.trapped_ball import fill, radii

ANY_COLOUR = 1e6
"""Slack of the growing limit at which no pixel leaves a new region."""


class PrintedSegmenter(Segmenter):
    """Segments consecutive frames. Each area in which a ball may move is one region; nothing is corrected or merged.

    Where the paper says nothing: pixels that are unlabelled at the end, which are edges and places too narrow for any
    ball, join the neighbouring region with the most similar colour.
    """

    def step(
        self, lab: Lab8, edges: Pending[NDArray[np.uint8]], importance: Plane, flow: Flow | None,
        residual: NDArray[np.uint8] | None, fading: bool = False, contrast: float = 1.0,
    ) -> Segmentation:  # fmt: skip
        """`Segmenter.step`; `residual` is `motion.flow_error`, and `fading` and `contrast` have no effect."""
        known, limit = self.last, self._limit(importance)
        if known is None or flow is None or residual is None:
            labels, propagated, count = np.zeros(self.shape, np.int32), NOT_PROPAGATED, 0
        else:
            still = np.zeros_like(self.remainder)  # the flow is rounded
            propagated, _ = propagate(known.labels, flow, still, residual, self.params.flow_error_limit, 0.0)
            labels, count = smooth_labels(propagated), len(known.ids) - 1
        sums = measure(labels, lab, limit, count)
        left = int(sums[0, AREA])
        if left:
            sums = self._fill(labels, lab, edges.result(), limit, sums)
        return self._finish(labels, propagated, sums, left, fading=False)

    def _fill(
        self, labels: Labels, lab: Lab8, edges: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums
    ) -> Sums:  # fmt: skip
        """Label all pixels, in place: grow, then fill with balls of decreasing radius and grow after each."""
        pixels = grow(labels, lab, edges, limit, sums, unlabelled(labels)) if len(sums) > 1 else unlabelled(labels)
        for radius in radii(len(pixels)):
            known = len(sums)
            made = fill(labels, edges, pixels, radius, known)
            sums = append_rows(sums, made)
            add_regions(labels, lab, limit, sums, pixels, known, ANY_COLOUR)
            pixels = grow(labels, lab, edges, limit, sums, pixels)
        if not sums[1:, AREA].any():  # the frame consists of edges: one region
            labels[:] = len(sums)
            return measure(labels, lab, limit, len(sums))
        grow(labels, lab, edges, limit, sums, pixels, np.inf)
        return sums
