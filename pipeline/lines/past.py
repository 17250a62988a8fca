"""The line response averaged with that of the previous frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel
from pipeline.lines.linking import Index

SPREAD = 5
"""Values along a curve are averaged over this many points on either side, twice."""
RESPONSE_TOLERANCE = np.float32(6)
"""Difference of responses, gray levels, at which the weight of the past is halved."""


class PastMotion(NamedTuple):
    """Motion since the previous frame, and how far it can be trusted.

    Attributes:
        flow: previous to current frame, float32 (h, w, 2), px of the line planes.
        residual: uint8 (h, w), difference of each pixel to its past (`motion.denoise`).
        weights: float32 (256,), weight of the past by residual, 0..1.
    """

    flow: Flow
    residual: NDArray[np.uint8]
    weights: NDArray[np.float32]


def blend_response(response: Plane, before: Plane, motion: PastMotion) -> Plane:
    """Average a line response with the previous one along the flow, where the two agree: float32 (h, w).

    The response is smooth, so that warping hardly moves its ridges.

    Args:
        response, before: float32 (h, w), gray levels, of this and the previous frame.
        motion: its weights are halved at a difference of `RESPONSE_TOLERANCE`.
    """
    out = np.empty_like(response)
    _blend_response(response, before, motion, out)
    return out


@kernel
def _blend_response(response: Plane, before: Plane, motion: PastMotion, out: Plane) -> None:
    height, width = response.shape
    flow, one = motion.flow, np.float32(1)
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            past = before[y, x]
            if dx != 0.0 or dy != 0.0:
                past = sample(before, np.float32(x) - dx, np.float32(y) - dy)
            apart = (past - response[y, x]) / RESPONSE_TOLERANCE
            weight = motion.weights[motion.residual[y, x]] / (one + apart * apart)
            out[y, x] = response[y, x] + weight * (past - response[y, x])


@kernel
def sample(plane: Plane, x: np.float32, y: np.float32) -> np.float32:
    """Sample a plane at (x, y), px; positions outside are clamped to the border."""
    height, width = plane.shape
    x = min(max(x, np.float32(0)), np.float32(width - 1))
    y = min(max(y, np.float32(0)), np.float32(height - 1))
    x0, y0 = int(x), int(y)
    x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
    fx, fy = x - np.float32(x0), y - np.float32(y0)
    top = plane[y0, x0] + fx * (plane[y0, x1] - plane[y0, x0])
    low = plane[y1, x0] + fx * (plane[y1, x1] - plane[y1, x0])
    return np.float32(top + fy * (low - top))


@kernel
def nearest(plane: Plane, x: np.float32, y: np.float32) -> np.float32:
    height, width = plane.shape
    value: np.float32 = plane[min(max(int(np.rint(y)), 0), height - 1), min(max(int(np.rint(x)), 0), width - 1)]
    return value


@kernel
def smooth_along(values: NDArray[np.float32], starts: Index) -> None:
    """Average values along each curve, in place."""
    for k in range(starts.size - 1):
        begin, end = starts[k], starts[k + 1]
        for _ in range(2):
            sums = np.zeros(end - begin + 1)
            for n in range(begin, end):
                sums[n - begin + 1] = sums[n - begin] + np.float64(values[n])
            for n in range(begin, end):
                a, b = max(n - SPREAD, begin) - begin, min(n + SPREAD + 1, end) - begin
                values[n] = np.float32((sums[b] - sums[a]) / (b - a))
