"""Detection of hard cuts from two consecutive frames, so that a live stream and a batch job find the same cuts."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.kernels.jit import kernel
from pipeline.kernels.selection import column_medians


@dataclass(frozen=True)
class CutParams:
    """Constants of cut detection."""

    thumbnail: tuple[int, int] = (32, 18)
    """(width, height) of thumbnails, px: small enough that motion within a shot changes them little."""
    rows_each: int = 4
    """Rows of the frame that are averaged for one row of the thumbnail."""
    difference: float = 32.0
    """Least mean difference of the thumbnails at a cut, 8-bit Lab levels summed over the channels."""
    correlation: float = 0.4
    """Correlation of lightness below which the thumbnails show different shots."""
    fading: float = 0.15
    """`light_steadiness` below which the light changes so fast that past colours predict nothing."""


CUTS = CutParams()


LAB_UNITS = np.array([100 / 255, 1, 1], np.float32)
"""CIELAB units in a level of L, a and b of 8-bit Lab."""


def thumbnail(frame: Frame) -> Plane:
    """Thumbnail of a frame: float32 (18, 32, 3), 8-bit Lab. Rows are skipped, since a few average out the noise."""
    step = max(1, frame.shape[0] // (CUTS.thumbnail[1] * CUTS.rows_each))
    small = cv2.resize(frame[::step], CUTS.thumbnail, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_RGB2LAB).astype(np.float32)


def is_cut(before: Plane, now: Plane, sensitivity: float = 1.0) -> bool:
    """Whether a new shot begins with `now`: the thumbnails differ strongly, and their lightness is weakly correlated.

    Args:
        sensitivity: divides the threshold `CUTS.difference`; 0 = no cuts.
    """
    if sensitivity <= 0:
        return False
    difference = _total_difference(before.reshape(-1), now.reshape(-1)) / before[..., 0].size
    if difference * sensitivity < CUTS.difference:
        return False
    return _correlation(before[..., 0], now[..., 0]) < CUTS.correlation


@kernel
def _total_difference(before: NDArray[np.float32], now: NDArray[np.float32]) -> float:
    """Sum of the absolute differences."""
    total = 0.0
    for k in range(before.size):
        total += abs(np.float64(now[k]) - before[k])
    return total


def light_steadiness(before: Plane, now: Plane) -> float:
    """Steadiness of the light, 0..1: exp(-(d / 0.8)^2) with the median change d in CIELAB units; near 0 in a fade.

    The median is used because a fade changes all places alike; a pan or a moving object does not.
    """
    shift = column_medians(now - before) * LAB_UNITS
    return float(np.exp(-((shift * shift).sum() / 0.8**2)))


def _correlation(a: Plane, b: Plane) -> float:
    """Pearson's correlation coefficient; 0 if a picture is flat."""
    x, y = a - a.mean(), b - b.mean()
    spread = float(np.sqrt((x * x).sum() * (y * y).sum()))
    return float((x * y).sum()) / spread if spread > 1 else 0.0
