"""Colour scheme replacement: shifting the colours of a video towards those of a reference (zhang2011online, section 5).

A reference is a video, an image, or a hue histogram drawn by the user. `learn` and `from_histogram` compute its
statistics, `hue_table` prepares eq. 1, and `apply` maps the colour of each region by eq. 1, 2 and 3. Eq. 4, the
blending between frames, is in `pipeline.methods.abstraction.palette`.

Departure:
    * The paper states both "k = 3" and "h_4 is the desired h'"; here the result is h_k.
    * "A 30 degree neighbourhood" is interpreted as the total width: 15 degrees to either side.
    * The statistics of the incoming frame come from every n-th pixel (at most `SCHEME.samples` of them: about 0.2 ms at
      1280x720) and are smoothed causally (`ToneTracker`). Without smoothing, exposure jitter would make all regions
      flicker.
    * The quotients sigma_S / sigma_s and mu_V / mu_v are limited to `SCHEME.max_gain`, since the noise of a nearly gray
    or
      nearly black frame would otherwise be amplified without bound.
    * As printed, eq. 2 gives a gray region (s = 0) the saturation mu_S - mu_s sigma_S / sigma_s: a white wall becomes
      vivid, with a random hue that changes each frame. The paper itself calls the hue of such pixels meaningless.
      Below S = `achromatic`, s is therefore changed less, and not at all at S = 0. `achromatic=0` is the paper's
      equation. On 40 frames of a 720p clip with a white shirt and table, gray areas that are still in the video (0.17
      CIELAB units per frame) change by 1.13 on average and 27.9 at most as printed, by 0.21 and 4.1 with this change.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import ceil, sqrt
from numbers import Real
from typing import NamedTuple, TypeGuard

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import JsonValue

from pipeline.arrays import Arrays, State
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.kernels.jit import kernel


class SchemeParams(NamedTuple):
    """Constants of colour schemes."""

    hues: int = 360
    """Bins of the hue histogram: bin i holds the hues that round to i degrees."""
    meaningless: float = 0.125
    """S or V up to which hue is meaningless; V up to which saturation is meaningless (section 5)."""
    samples: int = 1 << 15
    """Largest number of pixels of a frame that are read."""
    max_gain: float = 4.0
    """Largest quotient of a reference statistic and a frame statistic."""


SCHEME = SchemeParams()


HueTable = NDArray[np.float32]


@dataclass(frozen=True)
class Tone:
    """Statistics of a picture for eq. 2 and 3, each in 0..1: mu_S and sigma_S over V > .125, mu_V over all pixels."""

    saturation_mean: float
    saturation_std: float
    value_mean: float


@dataclass(frozen=True)
class ColourStats(Tone):
    """Colour scheme of a reference: its tone, and the hue histogram D over S > .125 and V > .125.

    Attributes:
        hue: float64 (360,), sums to 1; all zero if the reference has no colours.
    """

    hue: NDArray[np.float64]

    def as_json(self) -> dict[str, JsonValue]:
        """JSON object that `from_histogram` accepts, unless `hue` is all zero."""
        return {
            "hue": self.hue.tolist(),
            "saturation_mean": self.saturation_mean,
            "saturation_std": self.saturation_std,
            "value_mean": self.value_mean,
        }


def learn(frames: Iterable[Frame], field: str = "reference") -> ColourStats:
    """Compute the colour scheme of a video or image, with one frame in memory at a time.

    Raises:
        BadInput: there is no frame.
    """
    tones, hue = _Tones(), np.zeros(SCHEME.hues)
    for frame in frames:
        sample = _sample(frame)
        tones.add(sample)
        hue += _count_hues(sample)
    if not tones.pixels:
        raise BadInput("The reference has no frames.", field=field, remedy="Give a video or image that can be shown.")
    tone = tones.tone()
    return ColourStats(tone.saturation_mean, tone.saturation_std, tone.value_mean, hue / max(hue.sum(), 1.0))


def measure(frame: Frame) -> Tone:
    """Compute mu_s, sigma_s and mu_v of one frame, from at most `SCHEME.samples` pixels on a fixed grid."""
    tones = _Tones()
    tones.add(_sample(frame))
    return tones.tone()


class ToneTracker:
    """Smooths the tone of the incoming video by a causal exponential filter.

    Args:
        half_life_frames: half-life of a frame's weight, frames; 0 = no smoothing, as in the paper.
    """

    def __init__(self, half_life_frames: float = 12.0) -> None:
        self._gain = 1.0 - 0.5 ** (1.0 / half_life_frames) if half_life_frames > 0 else 1.0
        self._tone: NDArray[np.float64] | None = None

    def step(self, tone: Tone, cut: bool = False) -> Tone:
        """Process the tone of the next frame and return the smoothed tone; a cut resets the filter."""
        now = np.array([tone.saturation_mean, tone.saturation_std, tone.value_mean])
        self._tone = now if cut or self._tone is None else self._tone + self._gain * (now - self._tone)
        return Tone(*self._tone.tolist())

    def state(self) -> State:
        """State as arrays by name; a tracker restored from it continues with the same bytes."""
        return {"tone": np.empty(0) if self._tone is None else self._tone.copy()}

    def restore(self, state: Arrays) -> None:
        kept = np.asarray(state["tone"], np.float64)
        self._tone = kept.copy() if kept.size else None


def hue_table(stats: ColourStats, k: int = 3, neighbourhood_deg: float = 30.0) -> HueTable:
    """Eq. 1 for each whole degree: hue after `k` steps of mean shift on D.

    Hue is circular: 355 and 5 degrees are neighbours. A hue with an empty neighbourhood is unchanged.

    Returns: float32 (360,), degrees in [0, 360).
    """
    degrees = np.arange(SCHEME.hues, dtype=np.float64)
    hue = degrees.copy()
    for _ in range(k):
        apart = _wrapped(degrees[None, :] - hue[:, None])
        weight = np.where(np.abs(apart) <= neighbourhood_deg / 2, stats.hue[None, :], 0.0)
        mass = weight.sum(axis=1)
        hue += np.divide((weight * apart).sum(axis=1), mass, out=np.zeros(SCHEME.hues), where=mass > 0)
    wrapped: HueTable = (hue % SCHEME.hues).astype(np.float32)
    return wrapped % np.float32(SCHEME.hues)  # rounding to float32 may yield 360


def apply(
    stats_reference: ColourStats,
    stats_frame: Tone,
    hsv_regions: ArrayLike,
    lambda_: float = 2 / 3,
    *,
    table: HueTable | None = None,
    achromatic: float = SCHEME.meaningless,
    max_gain: float = SCHEME.max_gain,
) -> NDArray[np.float64]:
    """Target colour (h', s', v') of each region by eq. 1, 2 and 3.

    Args:
        stats_reference: mu_S, sigma_S, mu_V and D.
        stats_frame: mu_s, sigma_s, mu_v (`measure`, smoothed by `ToneTracker`).
        hsv_regions: (n, 3) mean colours, H in degrees, S and V in 0..1.
        lambda_: lambda of the paper, 0..1: share of the video's own brightness that is kept.
        table: `hue_table(stats_reference)`; None = computed by this call.
        achromatic: saturation, 0..1, below which eq. 2 has less effect; 0 = the paper's eq. 2.
        max_gain: largest quotient of eq. 2 and 3; infinite = the paper's.

    Returns: float64 (n, 3), H in [0, 360), S and V clipped to [0, 1].
    """
    hue, saturation, value = np.asarray(hsv_regions, np.float64).reshape(-1, 3).T
    shifted = _interpolate(hue_table(stats_reference) if table is None else table, hue)
    spread = _quotient(stats_reference.saturation_std, stats_frame.saturation_std, max_gain)
    matched = stats_reference.saturation_mean + (saturation - stats_frame.saturation_mean) * spread
    trust = _smoothstep(saturation / achromatic) if achromatic > 0 else 1.0
    quotient = _quotient(stats_reference.value_mean, stats_frame.value_mean, max_gain)
    brightness = lambda_ + (1 - lambda_) * quotient
    targets = np.stack([shifted, saturation + trust * (matched - saturation), value * brightness], axis=1)
    targets[:, 1:] = np.clip(targets[:, 1:], 0, 1)
    return targets


def from_histogram(data: object, field: str = "reference") -> ColourStats:
    """Colour scheme from a histogram drawn by the user.

    Args:
        data: parsed JSON {"hue": 36 or 360 weights, "saturation_mean", "saturation_std", "value_mean"}. Weight i is at
            10 i or i degrees (0 red, 120 green, 240 blue); 36 weights are interpolated linearly.

    Raises:
        BadInput: the data is invalid.
    """
    given = _object(data, field)
    return ColourStats(
        _fraction(given, "saturation_mean", field),
        _fraction(given, "saturation_std", field),
        _fraction(given, "value_mean", field),
        _weights(given["hue"], f"{field}.hue"),
    )


class _Tones:
    """Sums over pixels, from which `tone` is computed."""

    def __init__(self) -> None:
        self._sums = np.zeros(5)

    @property
    def pixels(self) -> int:
        return int(self._sums[0])

    def add(self, sample: Frame) -> None:
        _add_tones(sample, self._sums)

    def tone(self) -> Tone:
        pixels, lit, value, saturation, squares = self._sums.tolist()
        mean = saturation / max(lit, 1)
        variance = max(squares / max(lit, 1) - mean * mean, 0.0)
        return Tone(mean, sqrt(variance), value / max(pixels, 1))


@kernel
def _add_tones(sample: Frame, sums: NDArray[np.float64]) -> None:
    """Add to the sums: pixels; pixels with V > .125; V; S and S squared of pixels with V > .125."""
    pixels = lit = value = 0
    saturation = squares = 0.0
    for y in range(sample.shape[0]):
        for x in range(sample.shape[1]):
            r, g, b = sample[y, x, 0], sample[y, x, 1], sample[y, x, 2]
            high = max(r, g, b)
            pixels += 1
            value += high
            if high > SCHEME.meaningless * 255:
                s = (high - min(r, g, b)) / high
                lit += 1
                saturation += s
                squares += s * s
    sums[0] += pixels
    sums[1] += lit
    sums[2] += value / 255
    sums[3] += saturation
    sums[4] += squares


def _sample(frame: Frame) -> Frame:
    """At most `SCHEME.samples` pixels of a frame on a regular grid."""
    every = ceil(sqrt(max(frame.shape[0] * frame.shape[1] / SCHEME.samples, 1.0)))
    return frame[::every, ::every]


def _count_hues(sample: Frame) -> NDArray[np.int64]:
    """Number of pixels with a meaningful hue by rounded hue: int64 (360,)."""
    hsv = cv2.cvtColor(sample.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2HSV)
    hue, saturation, value = hsv.reshape(-1, 3).T
    coloured = hue[(value > SCHEME.meaningless) & (saturation > SCHEME.meaningless)]
    return np.bincount(np.rint(coloured).astype(np.intp) % SCHEME.hues, minlength=SCHEME.hues)


def _interpolate(table: HueTable, hue: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a hue table with linear interpolation of the shifts; the identity table leaves hues exactly unchanged."""
    shift = _wrapped(table.astype(np.float64) - np.arange(SCHEME.hues))
    whole = np.floor(hue)
    here = whole.astype(np.intp) % SCHEME.hues
    part = hue - whole
    moved = hue + shift[here] * (1 - part) + shift[(here + 1) % SCHEME.hues] * part
    return np.asarray(moved % SCHEME.hues)


def _wrapped(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of hues, mapped to [-180, 180)."""
    return np.asarray((degrees + 180) % 360 - 180)


def _quotient(reference: float, frame: float, largest: float) -> float:
    return min(reference / max(frame, 1e-6), largest)


def _smoothstep(x: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.clip(x, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


_KEYS = ("hue", "saturation_mean", "saturation_std", "value_mean")


def _object(data: object, field: str) -> Mapping[str, object]:
    wanted = f"Give one object with {', '.join(_KEYS)}."
    if not isinstance(data, Mapping):
        raise BadInput("A colour histogram is a JSON object.", field=field, value=type(data).__name__, remedy=wanted)
    for key in _KEYS:
        if key not in data:
            raise BadInput("The colour histogram lacks a key.", field=f"{field}.{key}", remedy=wanted)
    for key in data:
        if key not in _KEYS:
            raise BadInput("The colour histogram has an unknown key.", field=f"{field}.{key}", remedy=wanted)
    return data


def _fraction(data: Mapping[str, object], key: str, field: str) -> float:
    value = data[key]
    if not _is_number(value) or not 0 <= value <= 1:
        raise BadInput(
            f"{key} is a number from 0 to 1.", field=f"{field}.{key}", value=value, remedy="For example 0.4."
        )
    return float(value)


def _weights(values: object, field: str) -> NDArray[np.float64]:
    remedy = "Give 36 or 360 numbers of 0 or more, not all 0; weight 0 is red."
    if not isinstance(values, list) or len(values) not in (36, SCHEME.hues):
        size = len(values) if isinstance(values, list) else type(values).__name__
        raise BadInput("The hue histogram is a list of 36 or 360 weights.", field=field, value=size, remedy=remedy)
    for index, value in enumerate(values):
        if not _is_number(value) or not 0 <= value < 1e300:
            raise BadInput(
                "A hue weight is a number of 0 or more.", field=f"{field}[{index}]", value=value, remedy=remedy
            )
    weights = np.array(values, np.float64)
    if not weights.any():
        raise BadInput("The hue histogram is empty.", field=field, value="all 0", remedy=remedy)
    weights /= weights.max()
    spread = np.interp(
        np.arange(SCHEME.hues), np.arange(weights.size) * (SCHEME.hues / weights.size), weights, period=SCHEME.hues
    )
    return np.asarray(spread / spread.sum())


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool) and value == value
