"""Contrast of a shot: in a dim or hazy one, smaller differences of colour separate things."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.frames import Plane
from pipeline.perception.cuts import LAB_UNITS


@dataclass(frozen=True)
class ShotContrastParams:
    """Constants of the contrast of a shot."""

    usual: float = 20.0
    """Spread of the colours of a shot of usual contrast, see `spread`, CIELAB units. Of 90 clips, a quarter has
    less."""
    least: float = 0.5
    """Lowest contrast relative to the usual one, so that the noise of a uniform picture makes no regions."""
    gain: float = 0.2
    """Weight of the newest frame in the contrast of its shot: what moves into the picture changes it little by
    little."""


SHOT_CONTRAST = ShotContrastParams()


def spread(thumbnail: Plane) -> float:
    """Root mean square distance of the colours of a `cuts.thumbnail` from their mean, CIELAB units."""
    planes = (thumbnail * LAB_UNITS).reshape(-1, 3)
    return float(np.sqrt(planes.var(axis=0).sum()))


def contrast_after(before: float | None, thumbnail: Plane) -> float:
    """Contrast of a shot up to the frame with this thumbnail, relative to the usual one: `SHOT_CONTRAST.least`..1.

    Args:
        before: contrast up to the previous frame; None = a shot begins.
    """
    now = min(max(spread(thumbnail) / SHOT_CONTRAST.usual, SHOT_CONTRAST.least), 1.0)
    return now if before is None else before + SHOT_CONTRAST.gain * (now - before)
