"""Contrast of a shot: in a dim or hazy one, smaller differences of colour separate things."""

from __future__ import annotations

import numpy as np

from pipeline.frames import Plane
from pipeline.perception.cuts import LAB_UNITS

USUAL = 20.0
"""Spread of the colours of a shot of usual contrast, see `spread`, CIELAB units. Of 90 clips, a quarter has less."""
LEAST = 0.5
"""Lowest contrast relative to the usual one, so that the noise of a uniform picture makes no regions."""
GAIN = 0.2
"""Weight of the newest frame in the contrast of its shot: what moves into the picture changes it little by little."""


def spread(thumbnail: Plane) -> float:
    """Root mean square distance of the colours of a `cuts.thumbnail` from their mean, CIELAB units."""
    planes = (thumbnail * LAB_UNITS).reshape(-1, 3)
    return float(np.sqrt(planes.var(axis=0).sum()))


def contrast_after(before: float | None, thumbnail: Plane) -> float:
    """Contrast of a shot up to the frame with this thumbnail, relative to the usual one: `LEAST`..1.

    Args:
        before: contrast up to the previous frame; None = a shot begins.
    """
    now = min(max(spread(thumbnail) / USUAL, LEAST), 1.0)
    return now if before is None else before + GAIN * (now - before)
