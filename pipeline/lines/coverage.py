"""Lines as the area where a smooth field is positive, drawn anti-aliased at any size.

The field is the line response minus its threshold, and its zero contour is the outline of the lines. Lines are wide
where the response is strong, taper where it decreases, and are equally sharp at every output size.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel

PEAK_SHARE = 0.2
"""Least response of a line pixel as a share of the strongest response nearby; it limits the width of strong lines."""
RESPONSE_TOLERANCE = np.float32(6)
"""Difference of responses, gray levels, at which the weight of the past is halved."""


def line_field(response: Plane, importance: Plane, threshold: float, margin: float, reach_px: int) -> Plane:
    """Signed field whose zero contour outlines the lines, float32 (h, w), gray levels, positive inside.

    Args:
        response: difference of Gaussians, float32 (h, w), gray levels, positive on the dark side of an edge.
        importance: float32 (h, w), 0..1.
        threshold: least response of a line, gray levels; it is scaled by 1.25 - 0.75 * importance.
        margin: distance of the outline above the threshold, gray levels.
        reach_px: radius in which the strongest response is searched, px; about twice the sigma of the narrower
            Gaussian.
    """
    side = 2 * reach_px + 1
    peak = np.asarray(cv2.dilate(response, np.ones((side, side), np.uint8)), np.float32)
    out = np.empty_like(response)
    _field(response, peak, importance, np.float32(threshold), np.float32(margin), out)
    return out


@kernel
def _field(
    response: Plane, peak: Plane, importance: Plane, threshold: np.float32, margin: np.float32, out: Plane
) -> None:  # fmt: skip
    height, width = out.shape
    share = np.float32(PEAK_SHARE)
    for y in range(height):
        for x in range(width):
            least = threshold * (np.float32(1.25) - np.float32(0.75) * importance[y, x]) + margin
            out[y, x] = response[y, x] - max(least, share * peak[y, x])


def draw_lines(field: Plane, opacity: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Coverage of each pixel by lines, times their opacity: uint8 (height, width), 255 = full ink.

    Args:
        field: from `line_field`, float32 (h, w).
        opacity: uint8 (h, w), 0..255.
        size: (width, height) of the result, px; the planes are interpolated to it.
    """
    if (field.shape[1], field.shape[0]) != size:
        field = np.asarray(cv2.resize(field, size, interpolation=cv2.INTER_CUBIC), np.float32)
        opacity = np.asarray(cv2.resize(opacity, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    out = np.empty(field.shape, np.uint8)
    _draw(field, opacity, out)
    return out


@kernel
def _draw(field: Plane, opacity: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """Coverage from the distance to the zero contour, estimated as field / |gradient|, within half a pixel of it."""
    height, width = out.shape
    half, one = np.float32(0.5), np.float32(1)
    for y in range(height):
        row, above, below = field[y], field[max(y - 1, 0)], field[min(y + 1, height - 1)]
        for x in range(1, width - 1):  # this vectorises
            dx, dy = (row[x + 1] - row[x - 1]) * half, (below[x] - above[x]) * half
            slope = np.sqrt(dx * dx + dy * dy) + np.float32(1e-6)
            cover = min(max(half + row[x] / slope, np.float32(0)), one)
            out[y, x] = np.uint8(cover * np.float32(opacity[y, x]) + half)
        for x in (0, width - 1):
            out[y, x] = opacity[y, x] if row[x] > 0 else 0


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

    The response is smooth, so warping it does not blur the outlines of the lines.

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
                past = _bilinear(before, np.float32(x) - dx, np.float32(y) - dy)
            apart = (past - response[y, x]) / RESPONSE_TOLERANCE
            weight = motion.weights[motion.residual[y, x]] / (one + apart * apart)
            out[y, x] = response[y, x] + weight * (past - response[y, x])


@kernel
def _bilinear(plane: Plane, x: np.float32, y: np.float32) -> np.float32:
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


def blend_opacity(opacity: NDArray[np.uint8], before: NDArray[np.uint8], motion: PastMotion) -> NDArray[np.uint8]:
    """Average an opacity with the previous one along the flow: uint8 (h, w).

    Args:
        opacity, before: uint8 (h, w) of this and the previous frame.
    """
    out = np.empty_like(opacity)
    _blend_opacity(opacity, before, motion, out)
    return out


@kernel
def _blend_opacity(
    opacity: NDArray[np.uint8], before: NDArray[np.uint8], motion: PastMotion, out: NDArray[np.uint8]
) -> None:  # fmt: skip
    height, width = opacity.shape
    flow = motion.flow
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            i, j = x, y
            if dx != 0.0 or dy != 0.0:
                i = min(max(x - int(np.rint(dx)), 0), width - 1)
                j = min(max(y - int(np.rint(dy)), 0), height - 1)
            now = np.float32(opacity[y, x])
            weight = motion.weights[motion.residual[y, x]]
            out[y, x] = np.uint8(now + weight * (np.float32(before[j, i]) - now))
