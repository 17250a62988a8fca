"""Contrast of a shot and of its places: where it is low, smaller differences of colour separate things."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from pipeline.frames import Plane
from pipeline.segmentation.cuts import LAB_UNITS

USUAL, USUAL_PLACE = 20.0, 16.0
"""Spread of the colours of a shot and of a place of usual contrast, CIELAB units: root mean square distance from their
mean. Of 90 clips, a quarter has less than `USUAL`."""
LEAST = 0.5
"""Lowest contrast relative to the usual one, so that the noise of a uniform picture makes no regions."""
PLACE_CELLS, SMOOTH_CELLS = 5, 3
"""Sides of the windows in which the spread of a place is computed and smoothed, cells of a thumbnail."""
GAIN = 0.2
"""Weight of the newest frame: what moves changes the contrast little by little."""


class Contrast(NamedTuple):
    """How much colours differ in a shot, relative to a usual shot.

    Attributes:
        shot: `LEAST`..1, in the whole frame.
        places: float32 (18, 32), a grid over the frame: `shot` times the contrast of a place, `LEAST`..1.
    """

    shot: float
    places: Plane

    def weighted(self, weight: float) -> Contrast:
        """The contrast with that weight, 0..1; 0 = the usual contrast everywhere."""
        return Contrast(1 + weight * (self.shot - 1), 1 + np.float32(weight) * (self.places - 1))


def contrast_after(before: Contrast | None, thumbnail: Plane) -> Contrast:
    """Contrast of a shot up to the frame with this thumbnail, see `cuts.thumbnail`.

    Args:
        before: contrast up to the previous frame; None = a shot begins.
    """
    colours = thumbnail * LAB_UNITS
    shot = min(max(float(np.sqrt(colours.reshape(-1, 3).var(axis=0).sum())) / USUAL, LEAST), 1.0)
    window = (PLACE_CELLS, PLACE_CELLS)
    mean, squares = cv2.blur(colours, window), cv2.blur(colours * colours, window)
    spread = np.sqrt(np.maximum(squares - mean * mean, 0).sum(axis=2))
    sharp = np.clip(spread * np.float32(1 / USUAL_PLACE), np.float32(LEAST), np.float32(1))
    places = np.asarray(np.float32(shot) * cv2.blur(sharp, (SMOOTH_CELLS, SMOOTH_CELLS)), np.float32)
    if before is None:
        return Contrast(shot, places)
    return Contrast(
        before.shot + GAIN * (shot - before.shot), before.places + np.float32(GAIN) * (places - before.places)
    )
