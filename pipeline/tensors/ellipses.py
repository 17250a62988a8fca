"""Position, orientation and size of an object: the ellipse with the second moments of its mask."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.frames import Mask

ROUND = 0.95
"""Ratio of minor to major axis above which the orientation of a shape is undefined."""


@dataclass(frozen=True)
class Ellipse:
    """Centre (px), angle of the major axis (continuous over frames, so not limited to a range), and semi-axes (px)."""

    x: float
    y: float
    angle_rad: float
    major_px: float
    minor_px: float


def fit_ellipse(mask: Mask, before: Ellipse | None = None) -> Ellipse | None:
    """Fit the ellipse with the mask's centre and second moments; None if the mask is empty.

    Args:
        mask: bool (h, w).
        before: ellipse of the previous frame. Angles are defined modulo half a turn; the one nearest to the previous
            angle is returned, without `before` the one in [0, pi). An almost round shape keeps the previous angle.

    Source: kagaya2011video, section 3.2 (principal components of the pixels' positions).
    """
    y, x = np.nonzero(mask)
    if not len(x):
        return None
    dx, dy = x - x.mean(), y - y.mean()
    xx, xy, yy = float((dx * dx).mean()), float((dx * dy).mean()), float((dy * dy).mean())
    middle, spread = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    pixel = 1 / 12  # second moment of a single pixel, so that no ellipse has size 0
    major, minor = (2 * math.sqrt(max(0.0, m) + pixel) for m in (middle + spread, middle - spread))
    angle = math.atan2(2 * xy, xx - yy) / 2 % math.pi
    return continued(Ellipse(float(x.mean()), float(y.mean()), angle, major, minor), before)


def continued(ellipse: Ellipse, before: Ellipse | None) -> Ellipse:
    """The ellipse with the equivalent angle nearest to that of `before`; see `fit_ellipse`."""
    if before is None:
        return ellipse
    if ellipse.minor_px > ROUND * ellipse.major_px:
        return replace(ellipse, angle_rad=before.angle_rad)
    return replace(ellipse, angle_rad=_nearest(ellipse.angle_rad, before.angle_rad))


def track_ellipses(frames: Mapping[int, Ellipse]) -> dict[int, Ellipse]:
    """Ellipses of one region over a shot, by frame, with angles that are continuous in time."""
    out: dict[int, Ellipse] = {}
    before: Ellipse | None = None
    for frame in sorted(frames):
        before = out[frame] = continued(frames[frame], before)
    return out


def _nearest(angle_rad: float, before_rad: float) -> float:
    return angle_rad + math.pi * round((before_rad - angle_rad) / math.pi)
