"""Lines on thin coloured stripes vanish: poured coffee, a red thread, a green stem.

The line response is largest inside a dark stripe, whatever its colour, so that a coloured stripe as narrow as a line
would become a black line. An outline keeps its ink: the colour on one of its sides is similar.

Departure: this is not part of zhang2011online, whose lines are drawn over everything.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import LabPlanes
from pipeline.kernels.jit import kernel
from pipeline.lines.linking import Curves
from pipeline.lines.ridges import Points


class StripeParams(NamedTuple):
    """Constants of the choice of stripes: ranges in which the share of removed ink rises from 0 to 1."""

    chroma: tuple[float, float] = (22.0, 34.0)
    """Chroma of the stripe, CIELAB units."""
    lightness: tuple[float, float] = (80.0, 120.0)
    """Lightness of the stripe, 0..255: dark stripes stay lines."""
    hue_distance: tuple[float, float] = (12.0, 24.0)
    """Distance, in a and b, of its colour from the more similar one of its two sides, CIELAB units."""
    reach: np.float32 = np.float32(3.5)
    """Distance at which the sides are sampled, in standard deviations of the narrower Gaussian."""


STRIPES = StripeParams()


def stripe_shares(
    points: Points, curves: Curves, planes: LabPlanes, scale: float, sigma_px: float
) -> NDArray[np.float32]:  # fmt: skip
    """By how much each point of the curves lies on a thin coloured stripe, float32 (m,), 0..1.

    Args:
        planes: 8-bit CIELAB, uint8 (3, h, w).
        scale: px of these planes per px of the points.
        sigma_px: standard deviation of the narrower Gaussian, px of the points.
    """
    out = np.empty(len(curves.order), np.float32)
    _shares(points, curves.order, planes[0], planes[1], planes[2], np.float32(scale), np.float32(sigma_px), out)
    return out


@kernel
def _shares(
    points: Points, order: NDArray[np.int32], lightness: NDArray[np.uint8], a: NDArray[np.uint8], b: NDArray[np.uint8],
    scale: np.float32, sigma_px: np.float32, out: NDArray[np.float32],
) -> None:  # fmt: skip
    height, width = lightness.shape
    reach, half = STRIPES.reach * sigma_px * scale, np.float32(0.5)
    for n in range(order.size):
        point = points[order[n]]
        x, y = (point["x"] + half) * scale - half, (point["y"] + half) * scale - half
        i, j = min(max(int(np.rint(x)), 0), width - 1), min(max(int(np.rint(y)), 0), height - 1)
        own_a, own_b = np.float32(a[j, i]), np.float32(b[j, i])
        share = _between(_distance(own_a, own_b, np.float32(128), np.float32(128)), STRIPES.chroma)
        share *= _between(np.float32(lightness[j, i]), STRIPES.lightness)
        for way in (-1, 1):
            if share == 0:
                break
            dx, dy = -point["along_y"] * reach * way, point["along_x"] * reach * way
            u, v = min(max(int(np.rint(x + dx)), 0), width - 1), min(max(int(np.rint(y + dy)), 0), height - 1)
            share *= _between(_distance(own_a, own_b, np.float32(a[v, u]), np.float32(b[v, u])), STRIPES.hue_distance)
        out[n] = share


@kernel
def _between(value: np.float32, limits: tuple[float, float]) -> np.float32:
    """0 up to the lower limit, rising to 1 at the upper one."""
    share: float = (float(value) - limits[0]) / (limits[1] - limits[0])
    return np.float32(min(max(share, 0.0), 1.0))


@kernel
def _distance(a: np.float32, b: np.float32, other_a: np.float32, other_b: np.float32) -> np.float32:
    return np.float32(np.sqrt((a - other_a) * (a - other_a) + (b - other_b) * (b - other_b)))
