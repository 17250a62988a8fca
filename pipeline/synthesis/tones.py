"""Guides made of a painting and of a video, so that the one's lightness and hue can be compared with the other's.

Most users have a painting and no picture of what it was painted from. Its own smoothed lightness and colour take that
place; and the video's are given the painting's distribution, as Image Analogies does with lightness, since a bright
video over a dark painting would otherwise find one end of it alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.synthesis.images import Bytes

_STEP = 2
_LEAST_SPREAD = 4.0


@dataclass(frozen=True)
class Tones:
    """The distribution of lightness and hue in pictures: 8-bit CIELAB."""

    lightness: NDArray[np.float64]
    """(256,) cumulative share."""
    hue_mean: NDArray[np.float64]
    hue_spread: NDArray[np.float64]
    """(2,) standard deviations of a and b."""


class Tally:
    """Tones of pictures seen one after the other; whole numbers, so that their order does not matter."""

    def __init__(self) -> None:
        self._counts = np.zeros(256, np.int64)
        self._sums = np.zeros((2, 2), np.int64)

    def add(self, guide: Bytes) -> None:
        """Count a picture, CIELAB uint8 (h, w, 3): every second pixel of every second row."""
        part = guide[::_STEP, ::_STEP].astype(np.int64)
        self._counts += np.bincount(part[..., 0].ravel(), minlength=256)
        for order in (1, 2):
            self._sums[order - 1] += (part[..., 1:] ** order).sum((0, 1))

    def tones(self) -> Tones:
        count = max(1, int(self._counts.sum()))
        mean = self._sums[0] / count
        spread = np.sqrt(np.maximum(self._sums[1] / count - mean**2, 0))
        return Tones(np.cumsum(self._counts) / count, mean, spread)


def tones_of(guides: Iterable[Bytes]) -> Tones:
    """The tones of some pictures together, CIELAB."""
    tally = Tally()
    for guide in guides:
        tally.add(guide)
    return tally.tones()


def lab_guide(picture: Frame) -> Bytes:
    """CIELAB in 8 bit: uint8 (h, w, 3)."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2Lab), np.uint8)


def derived_guide(painting: Frame, smoothing_px: float) -> Bytes:
    """What takes a style input's place: the painting's lightness and colour without strokes, edges kept.

    Args:
        smoothing_px: standard deviation of the Gaussian before the edge-keeping (bilateral) one.
    """
    smooth = cv2.GaussianBlur(painting, (0, 0), smoothing_px) if smoothing_px > 0.1 else painting
    return lab_guide(np.asarray(cv2.bilateralFilter(smooth, -1, 25, max(1.0, 4 * smoothing_px)), np.uint8))


class Matched:
    """Gives a guide the tones of another.

    Lightness by matching distributions, hue by mean and standard deviation.

    Source: hertzmann2001analogies, section 3.4 (lightness, by mean and deviation). Departure: distributions, and hue.
    """

    def __init__(self, own: Tones, wanted: Tones) -> None:
        found = np.searchsorted(wanted.lightness, own.lightness - 1e-9).clip(0, 255)
        levels = np.arange(256.0)[:, None]
        scale = wanted.hue_spread / np.maximum(own.hue_spread, _LEAST_SPREAD)
        hues = np.rint((levels - own.hue_mean) * scale + wanted.hue_mean).clip(0, 255)
        self._table = np.ascontiguousarray(np.column_stack([found, hues]).astype(np.uint8)[None])

    def __call__(self, guide: Bytes) -> Bytes:
        return np.asarray(cv2.LUT(guide, self._table), np.uint8)
