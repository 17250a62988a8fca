"""CIELAB guides of a painting and of a video, with matched tones.

Most users have a painting but not the picture that it was painted from. The smoothed lightness and colour of the
painting replace that picture. The guides of the video are mapped to the tone distribution of the painting, as Image
Analogies does for lightness; otherwise a bright video would match only the brightest parts of a dark painting.
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
_SLOPE_WINDOW = 17
"""Number of lightness levels over which the slope of a curve is measured; odd."""


@dataclass(frozen=True)
class ToneStatistics:
    """Distribution of lightness and hue of images in 8-bit CIELAB."""

    lightness: NDArray[np.float64]
    """Cumulative distribution of lightness, 0..1, shape (256,)."""
    hue_mean: NDArray[np.float64]
    hue_spread: NDArray[np.float64]
    """Standard deviations of a and b, shape (2,)."""


class ToneAccumulator:
    """Accumulates `ToneStatistics` over images. Uses integer sums, so that the order of the images does not matter."""

    def __init__(self) -> None:
        self._counts = np.zeros(256, np.int64)
        self._sums = np.zeros((2, 2), np.int64)

    def add(self, guide: Bytes) -> None:
        """Add an image, CIELAB uint8 (h, w, 3); counts every second pixel of every second row."""
        part = guide[::_STEP, ::_STEP].astype(np.int64)
        self._counts += np.bincount(part[..., 0].ravel(), minlength=256)
        for order in (1, 2):
            self._sums[order - 1] += (part[..., 1:] ** order).sum((0, 1))

    def statistics(self) -> ToneStatistics:
        """The statistics of all images so far."""
        count = max(1, int(self._counts.sum()))
        mean = self._sums[0] / count
        spread = np.sqrt(np.maximum(self._sums[1] / count - mean**2, 0))
        return ToneStatistics(np.cumsum(self._counts) / count, mean, spread)


def tone_statistics(guides: Iterable[Bytes]) -> ToneStatistics:
    """Joint tone statistics of several CIELAB images, uint8 (h, w, 3)."""
    accumulator = ToneAccumulator()
    for guide in guides:
        accumulator.add(guide)
    return accumulator.statistics()


def lab_guide(picture: Frame) -> Bytes:
    """Convert a frame to 8-bit CIELAB, uint8 (h, w, 3)."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2Lab), np.uint8)


def derived_guide(painting: Frame, smoothing_px: float) -> Bytes:
    """Substitute for a missing style input: the painting in CIELAB with strokes smoothed away and edges preserved.

    Args:
        smoothing_px: standard deviation of the Gaussian filter that precedes the bilateral filter, px.
    """
    smooth = cv2.GaussianBlur(painting, (0, 0), smoothing_px) if smoothing_px > 0.1 else painting
    return lab_guide(np.asarray(cv2.bilateralFilter(smooth, -1, 25, max(1.0, 4 * smoothing_px)), np.uint8))


class ToneMatch:
    """Maps the tones of one guide to those of another: lightness by histogram matching, hue by mean and deviation.

    Source: hertzmann2001analogies, section 3.4, which matches mean and deviation of the lightness. Departures: matches
    the whole distribution of lightness, and also hue. The slope of the lightness curve and the factor of the hues are
    limited, because a steep curve turns the noise of a flat area into blotches, and a flat one erases faces.

    Args:
        own: tones of the images that are mapped.
        wanted: tones that they are mapped to.
        limit: largest factor by which contrast is raised or lowered, >= 1.
    """

    def __init__(self, own: ToneStatistics, wanted: ToneStatistics, limit: float) -> None:
        scale = np.minimum(wanted.hue_spread / np.maximum(own.hue_spread, _LEAST_SPREAD), limit)
        hues = (np.arange(256.0)[:, None] - own.hue_mean) * scale + wanted.hue_mean
        table = np.column_stack([_lightness_curve(own, wanted, limit), hues])
        self._table = np.ascontiguousarray(np.rint(table).clip(0, 255).astype(np.uint8)[None])

    def __call__(self, guide: Bytes) -> Bytes:
        return np.asarray(cv2.LUT(guide, self._table), np.uint8)


def _lightness_curve(own: ToneStatistics, wanted: ToneStatistics, limit: float) -> NDArray[np.float64]:
    """Lightness for each lightness 0..255: matches the distributions, but with slopes between 1 / limit and limit.

    The mean lightness of the result is the one that matching without limits gives.
    """
    matched = np.searchsorted(wanted.lightness, own.lightness - 1e-9).clip(0, 255).astype(np.float64)
    darkest = int(np.argmax(own.lightness > 0))
    matched[:darkest] = matched[darkest]
    shares = np.diff(own.lightness, prepend=0.0)
    around = np.pad(matched, _SLOPE_WINDOW // 2, "edge")
    slopes = (around[_SLOPE_WINDOW - 1 :] - around[: 1 - _SLOPE_WINDOW]) / (_SLOPE_WINDOW - 1)
    curve = np.cumsum(slopes.clip(1 / limit, limit))
    return np.asarray(curve + (shares * (matched - curve)).sum(), np.float64)
