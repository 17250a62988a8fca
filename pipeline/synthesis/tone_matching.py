"""CIELAB guides of a painting and of a video, with matched tones.

Most users have a painting but not the picture that it was painted from. The smoothed lightness and colour of the
painting replace that picture. The guides of the video are mapped to the tone distribution of the painting, as Image
Analogies does for lightness; otherwise a bright video would match only the brightest parts of a dark painting.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.synthesis.images import Bytes


class ToneParams(NamedTuple):
    """Constants of tone matching."""

    step: int = 2
    least_spread: float = 4.0
    slope_window: int = 17
    """Number of lightness levels over which the slope of a curve is measured; odd."""
    contrast_size_px: int = 160
    """Longer side of the reduced image on which contrasts are measured, px: objects, not details, differ at this
    size."""
    contrast_distance_px: int = 2
    """Distance between two pixels whose contrast is measured, px of the reduced image."""
    contrast_bins: int = 64
    least_likeness: float = 0.88
    """Minimum likeness of contrasts; below it, matching raises contrast less. Of 18 pairs of a clip and a painting,
    17 have 0.90 to 0.99 at a limit of 2; a white bird in front of a wall with bright windows, in The Great Wave,
    has 0.82."""
    trials: int = 17
    """Number of limits that are tried."""
    lean: float = 0.05
    leans: int = 200
    """Share by which one step makes the darkest and brightest tones of a painting rarer or more frequent, and most
    steps."""
    least_used: float = 0.25
    """Minimum share of a painting that is used, however dark or bright the video is: fewer pieces would repeat."""
    extreme_share: float = 0.001
    """Share of a painting's pixels, at either end of its lightness, that do not count for its range."""
    base_size_px: int = 240
    """Longer side of the reduced image on which details are separated from the lightness around them, px."""
    detail_radius_px: int = 4
    """Radius of details, px of that image: the eyes of a face that is a sixth of the frame high are details."""
    least_edge: float = 20.0
    """Standard deviation of lightness, levels, above which a neighbourhood has an edge, not only details."""
    fractions: int = 16
    """Entries of the table of lightness per level."""


TONE = ToneParams()


NO_CONTRASTS = np.zeros((TONE.contrast_bins, TONE.contrast_bins), np.int64)
"""Unknown contrasts, or those of images without contrast. `ToneMatch` then applies its limit unchanged."""


@dataclass(frozen=True)
class ToneStatistics:
    """Distribution of lightness and hue of images in 8-bit CIELAB."""

    lightness: NDArray[np.float64]
    """Cumulative distribution of lightness, 0..1, shape (256,)."""
    hue_mean: NDArray[np.float64]
    hue_spread: NDArray[np.float64]
    """Standard deviations of a and b, shape (2,)."""
    contrasts: NDArray[np.int64]
    """Number of pairs of nearby pixels by the lightness of both, shape (bins, bins)."""


class ToneAccumulator:
    """Accumulates `ToneStatistics` over images. Uses integer sums, so that the order of the images does not matter."""

    def __init__(self) -> None:
        self._counts = np.zeros(256, np.int64)
        self._sums = np.zeros((2, 2), np.int64)
        self._contrasts = np.zeros(TONE.contrast_bins**2, np.int64)

    def add(self, guide: Bytes, inside: Mask | None = None) -> None:
        """Add an image, CIELAB uint8 (h, w, 3); counts every second pixel of every second row.

        Args:
            inside: the pixels that count, (h, w); None = all.
        """
        part = guide[:: TONE.step, :: TONE.step]
        part = part.reshape(-1, 3) if inside is None else part[inside[:: TONE.step, :: TONE.step]]
        lightness, *hue = (np.bincount(part[:, channel], minlength=256) for channel in range(3))
        self._counts += lightness
        for order in (1, 2):
            self._sums[order - 1] += np.array([(counts * np.arange(256) ** order).sum() for counts in hue])
        self._add_contrasts(guide[..., 0], inside)

    def _add_contrasts(self, lightness: Bytes, inside: Mask | None) -> None:
        scale = min(1.0, TONE.contrast_size_px / max(lightness.shape))
        size = [max(1, round(side * scale)) for side in lightness.shape[::-1]]
        small = cv2.resize(lightness, size, interpolation=cv2.INTER_AREA) // (256 // TONE.contrast_bins)
        bins = np.asarray(small, np.int64)
        if inside is not None:
            bins[cv2.resize(inside.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 0] = -1
        near = TONE.contrast_distance_px
        for one, other in ((bins[:, :-near], bins[:, near:]), (bins[:-near], bins[near:])):
            counted = (one >= 0) & (other >= 0)
            pairs = one[counted] * TONE.contrast_bins + other[counted]
            self._contrasts += np.bincount(pairs, minlength=len(self._contrasts))

    def statistics(self) -> ToneStatistics:
        """The statistics of all images so far."""
        count = max(1, int(self._counts.sum()))
        mean = self._sums[0] / count
        spread = np.sqrt(np.maximum(self._sums[1] / count - mean**2, 0))
        contrasts = self._contrasts.reshape(TONE.contrast_bins, TONE.contrast_bins).copy()
        return ToneStatistics(np.cumsum(self._counts) / count, mean, spread, contrasts)


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
    return lab_guide(smoothed(painting, smoothing_px))


def smoothed(painting: Frame, smoothing_px: float) -> Frame:
    """A painting without its strokes, uint8 (h, w, 3), see `derived_guide`."""
    smooth = cv2.GaussianBlur(painting, (0, 0), smoothing_px) if smoothing_px > 0.1 else painting
    return np.asarray(cv2.bilateralFilter(smooth, -1, 25, max(1.0, 4 * smoothing_px)), np.uint8)


class ToneMatch:
    """Maps the tones of one guide to those of another: lightness by histogram matching, hue by mean and deviation.

    Source: hertzmann2001analogies, section 3.4, which matches mean and deviation of the lightness. Departures: matches
    the whole distribution of lightness, and also hue. A dark or bright video uses more of the dark or bright paint,
    see `_leaning`: otherwise a night would become a day. The slope of the lightness curve is limited, because a steep
    curve enlarges small differences to blotches, and a flat one erases contours. If raising it to the limit would leave
    too little contrast between other areas of the scene, it is raised less. Details, such as the eyes
    of a small face, keep the contrast of the video (durand2002bilateral, with the filter of he2015fast).

    Args:
        own: tones of the images that are mapped.
        wanted: tones that they are mapped to.
        limit: largest factor by which contrast of lightness is raised or lowered, >= 1; the mean lightness changes by
            the root of it at most, as far as the painting has such tones.

    Attributes:
        hue_weight: factor on the weight of hue differences, 0..1. It is below 1 if hues are raised by more than the
            limit: their noise then counts as at the limit.
    """

    def __init__(self, own: ToneStatistics, wanted: ToneStatistics, limit: float) -> None:
        spread = np.maximum(own.hue_spread, TONE.least_spread)
        hues = (np.arange(256.0)[:, None] - own.hue_mean) * (wanted.hue_spread / spread) + wanted.hue_mean
        self._hues = np.rint(hues).clip(0, 255).astype(np.uint8)
        levels = np.arange(255 * TONE.fractions + 1) / TONE.fractions
        self._lightness = np.interp(levels, np.arange(256), _lightness_curve(own, wanted, limit)).astype(np.float32)
        raised = math.hypot(*wanted.hue_spread) / math.hypot(*spread)
        self.hue_weight = min(1.0, (limit / max(raised, 1.0)) ** 2)

    def __call__(self, guide: Bytes) -> Bytes:
        matched = np.empty_like(guide)
        _apply(guide, *_base_model(guide[..., 0]), self._lightness, self._hues, matched)
        return matched


def _base_model(lightness: Bytes) -> tuple[Plane, Plane]:
    """Coefficients of the lightness without details, a local linear function of the lightness: factor and offset,
    float32 (h, w).

    Details are smoothed away, edges are preserved. Source: he2015fast, algorithm 2 (guided filter whose coefficients
    are computed at a smaller size).
    """
    size = lightness.shape[1::-1]
    scale = min(1.0, TONE.base_size_px / max(size))
    small_size = [max(1, round(side * scale)) for side in size]
    small = np.asarray(cv2.resize(lightness, small_size, interpolation=cv2.INTER_AREA), np.float32)
    mean = _box_mean(small)
    variance = _box_mean(small * small) - mean * mean
    slope = np.asarray(variance / (variance + TONE.least_edge**2), np.float32)
    factor, offset = (
        np.asarray(cv2.resize(_box_mean(plane), size, interpolation=cv2.INTER_LINEAR), np.float32)
        for plane in (slope, mean - slope * mean)
    )
    return factor, offset


def _box_mean(plane: Plane) -> Plane:
    return np.asarray(cv2.boxFilter(plane, -1, (2 * TONE.detail_radius_px + 1,) * 2), np.float32)


@kernel
def _apply(
    guide: Bytes, factor: Plane, offset: Plane, lightness: NDArray[np.float32], hues: Bytes, out: Bytes
) -> None:  # fmt: skip
    """Map a guide: the lightness without details by the table `lightness`, a and b by the table `hues`."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            own = np.float32(guide[y, x, 0])
            base = min(max(factor[y, x] * own + offset[y, x], np.float32(0.0)), np.float32(255.0))
            entry = lightness[np.int32(base * np.float32(TONE.fractions) + np.float32(0.5))]
            matched = entry + (own - base) + np.float32(0.5)
            out[y, x, 0] = np.uint8(min(max(matched, np.float32(0.0)), np.float32(255.0)))
            out[y, x, 1] = hues[guide[y, x, 1], 0]
            out[y, x, 2] = hues[guide[y, x, 2], 1]


def _lightness_curve(own: ToneStatistics, wanted: ToneStatistics, limit: float) -> NDArray[np.float64]:
    """Lightness for each lightness 0..255: matches the distributions within the limit of contrast.

    Slopes are at least 1 / `limit`. Their maximum is the largest value from `limit` down to 1 that keeps the likeness
    of contrasts (`TONE.least_likeness`).
    """
    curve = np.arange(256.0)
    wanted = _leaning(own, wanted, math.sqrt(limit))
    for raised in np.geomspace(limit, 1, TONE.trials):
        curve = _limited_curve(own, wanted, 1 / limit, float(raised))
        if _likeness(own, wanted, curve) >= TONE.least_likeness:
            break
    return curve


def _leaning(own: ToneStatistics, wanted: ToneStatistics, most: float) -> ToneStatistics:
    """The tones of a painting, with dark ones more frequent if the video is darker, or bright ones if it is brighter.

    The mean lightness of the painting then is that of the video within the factor `most`, unless less than
    `TONE.least_used` of the painting would be used. Source: the outlook of benard2013stylizing, section 6, to derive
    the desired use of the style from the input.
    """
    levels, shares = np.arange(256.0), np.diff(wanted.lightness, prepend=0.0)
    mean = (np.diff(own.lightness, prepend=0.0) * levels).sum()
    given = (shares * levels).sum()
    direction = float(np.sign(np.clip(given, mean / most, mean * most) - given))
    if given == 0 or direction == 0:
        return wanted
    weights, factors = np.ones(256), 1 + direction * TONE.lean * (levels / 127.5 - 1)
    for _ in range(TONE.leans):
        leant = weights * factors
        leant /= (shares * leant).sum()
        now = (shares * leant * levels).sum()
        arrived = now >= mean / most if direction > 0 else now <= mean * most
        if arrived or (shares * leant**2).sum() * TONE.least_used > 1:
            break
        weights = leant
    return replace(wanted, lightness=np.cumsum(shares * weights))


def _limited_curve(own: ToneStatistics, wanted: ToneStatistics, least: float, most: float) -> NDArray[np.float64]:
    """The curve that matches the distributions, but with slopes between `least` and `most`.

    The mean lightness of the result is the one that matching without limits gives.
    """
    matched = np.searchsorted(wanted.lightness, own.lightness - 1e-9).clip(0, 255).astype(np.float64)
    darkest = int(np.argmax(own.lightness > 0))
    matched[:darkest] = matched[darkest]
    shares = np.diff(own.lightness, prepend=0.0)
    around = np.pad(matched, TONE.slope_window // 2, "edge")
    slopes = (around[TONE.slope_window - 1 :] - around[: 1 - TONE.slope_window]) / (TONE.slope_window - 1)
    curve = np.cumsum(slopes.clip(least, most))
    return np.asarray(curve + (shares * (matched - curve)).sum(), np.float64)


def _likeness(own: ToneStatistics, wanted: ToneStatistics, curve: NDArray[np.float64]) -> float:
    """Correlation of the contrasts between nearby pixels before and after a curve, -1..1; 1 without any contrast.

    Tones beyond the range of the painting count as its darkest or brightest tone.
    """
    if not own.contrasts.any():
        return 1.0
    darkest, brightest = np.searchsorted(wanted.lightness, (TONE.extreme_share, 1 - TONE.extreme_share))
    step = 256 // TONE.contrast_bins
    bins = np.arange(step / 2, 256, step)
    shown = np.interp(bins, np.arange(256), curve).clip(darkest, brightest)
    contrasts = [np.abs(np.subtract.outer(tones, tones)) for tones in (bins, shown)]
    shares = np.asarray(own.contrasts / own.contrasts.sum(), np.float64)
    before, after = (contrast - (shares * contrast).sum() for contrast in contrasts)
    spread = math.sqrt((shares * before**2).sum() * (shares * after**2).sum())
    return float((shares * before * after).sum() / spread) if spread > 0 else 1.0
