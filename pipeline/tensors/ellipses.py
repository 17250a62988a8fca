"""Where an object is, how it is turned and how large: the ellipse that fits its mask best, by its second moments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.frames import Mask

ROUND = 0.95
"""Ratio of the axes above which a shape has no direction of its own."""


@dataclass(frozen=True)
class Ellipse:
    """Centre (px), the major axis's angle (not limited: it goes on from frame to frame), and semi-axes (px)."""

    x: float
    y: float
    angle_rad: float
    major_px: float
    minor_px: float


def fit_ellipse(mask: Mask, before: Ellipse | None = None) -> Ellipse | None:
    """The ellipse with the mask's centre and second moments; None if the mask is empty.

    Args:
        mask: bool (h, w).
        before: the ellipse of the frame before. An axis has no sign, so of all angles half turns apart the nearest to
            the one before is taken; without, the one in [0, pi). A shape that is almost round keeps the one before.

    Source: kagaya2011video, section 3.2 (principal components of the pixels' positions).
    """
    y, x = np.nonzero(mask)
    if not len(x):
        return None
    dx, dy = x - x.mean(), y - y.mean()
    xx, xy, yy = float((dx * dx).mean()), float((dx * dy).mean()), float((dy * dy).mean())
    middle, spread = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    pixel = 1 / 12  # a pixel's own, so that even a single one has a size
    major, minor = (2 * math.sqrt(max(0.0, m) + pixel) for m in (middle + spread, middle - spread))
    angle = math.atan2(2 * xy, xx - yy) / 2 % math.pi
    if before is not None:
        angle = before.angle_rad if minor > ROUND * major else _nearest(angle, before.angle_rad)
    return Ellipse(float(x.mean()), float(y.mean()), angle, major, minor)


def _nearest(angle_rad: float, before_rad: float) -> float:
    return angle_rad + math.pi * round((before_rad - angle_rad) / math.pi)
