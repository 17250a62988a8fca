"""Weights of the energy function, and the integer tables that the kernels and the reference implementation share.

Eq. 1 and 2 of benard2013stylizing: the cost of a patch is a Gaussian-weighted sum over its taps of differences of
output colours, guides and offsets, plus terms of the centre pixel only. Colours and guides are bytes. Their differences
are multiplied by integers (the scaled square roots of the weights) and squared, so that the sum is exact in 32-bit
integers, in any order, on any processor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

DIRECTIONS = 64
"""Number of directions in 180 degrees, in steps of 2.8 degrees: a quarter of a pixel at the edge of a 9x9 patch."""
NO_DIRECTION = 255
SCALE_SHIFT = 4
TAP_WEIGHT_SCALE = 16
_LANES, _MAX_SUM = 8, 2**32 - 1
_MAX_SCALE = 32.0
CHANGE_FRACTION_UNIT = 128

Shorts: TypeAlias = NDArray[np.int16]


@dataclass(frozen=True)
class Energy:
    """Weights and parameters of the terms of eq. 2 and 10. Weights are relative to squared gray levels (0..255).

    The weight of a guide is divided among its channels, and so is the weight of the output colour.

    Attributes:
        colours: channels of the output: 3, or 4 with opacity.
        radius: patch radius, px; patches are 2 radius + 1 px wide.
        sigma_px: standard deviation of the Gaussian that weights the taps of a patch, px.
        w_out: weight of the output colour.
        guides: weight of each guide channel (w_in).
        w_sc: weight of spatial coherence (eq. 5), per px^2.
        r_max_px2: limit of the squared distance in eq. 5, px^2.
        w_tc: weight of temporal coherence (eq. 6 and 7).
        kept_cost: factor, 0..1, on the cost of the advected offset when it is compared with other candidates; 1 = no
            preference.
        w_h: weight of the histogram penalty (eq. 8), per use of a style pixel in excess of the limit; includes h_s.
        h_limit: h_tau, number of uses without penalty, as a multiple of the mean number of uses of a style pixel.
        w_dt: weight of the distance to lines (eq. 9), per px^2.
        d_max_px: limit of the difference in eq. 9, px.
        w_din: weight of the change of the guides (eq. 10), relative to the weight of the guides.
        w_dout: weight of the change of the output colour.
    """

    colours: int = 3
    radius: int = 4
    sigma_px: float = 3.0
    w_out: float = 1.0
    guides: tuple[float, ...] = (1.0,)
    w_sc: float = 0.0
    r_max_px2: float = 16.0
    w_tc: float = 0.0
    kept_cost: float = 1.0
    w_h: float = 0.0
    h_limit: float = 1.0
    w_dt: float = 0.0
    d_max_px: float = 10.0
    w_din: float = 0.0
    w_dout: float = 0.0

    @property
    def side(self) -> int:
        """Width of a patch, px."""
        return 2 * self.radius + 1

    @property
    def pad(self) -> int:
        """Maximum distance of a tap of a rotated patch from its centre along x or y, px."""
        return math.ceil(self.radius * math.sqrt(2.0))

    @property
    def channels(self) -> int:
        """Bytes per pixel: colours and guides, padded so that a vector holds whole pixels."""
        needed = self.colours + len(self.guides)
        return next(size for size in (4, 8, 16, 32) if needed <= size)

    @property
    def vectors(self) -> int:
        """Number of 16-byte vectors per row of a patch."""
        return -(-self.side * self.channels // 16)

    @property
    def has_change_terms(self) -> bool:
        """Whether the energy has the terms of eq. 10, which need the neighbouring frame's appearance."""
        return self.w_din > 0 or self.w_dout > 0


@dataclass(frozen=True)
class Tables:
    """The weights of an energy function as integers.

    Attributes:
        weights: multiplier of each byte of the rows of a patch, (side, 16 vectors).
        change_fraction: share of eq. 10 in the weight of each channel of a pixel, in units of 1/128, (channels,).
        unit: cost of one squared gray level at the centre tap with weight 1.
        centre: cost of the value 1 in a centre term: the sum of the patch weights, as eq. 2 sums the term over the
            patch.
        tap_weights: weight of each tap of a row in eq. 5, (side, 16).
    """

    weights: Shorts
    change_fraction: Shorts
    unit: float
    centre: float
    tap_weights: NDArray[np.int32]


@lru_cache(maxsize=64)
def tables(energy: Energy) -> Tables:
    """The tables of an energy function."""
    falloff = _falloff(energy)
    plain = _bytes(energy, falloff, (energy.w_out, energy.guides))
    change = _bytes(energy, falloff, (energy.w_dout, tuple(energy.w_din * w for w in energy.guides)))
    both = plain + change
    scale = _scale(both)
    unit = scale**2 / (1 << SCALE_SHIFT)
    steps = np.zeros((energy.side, 16), np.int32)
    steps[:, : energy.side] = np.rint(falloff * TAP_WEIGHT_SCALE)
    weights = np.rint(scale * np.sqrt(both)).astype(np.int16)
    channels = slice(0, energy.channels)
    share = change[energy.radius, channels] / np.maximum(both[energy.radius, channels], 1e-12)
    change_fraction = np.rint(CHANGE_FRACTION_UNIT * share).astype(np.int16)
    return Tables(weights, change_fraction, unit, float(falloff.sum()) * unit, steps)


def _falloff(energy: Energy) -> NDArray[np.float64]:
    along = np.exp(-(np.arange(-energy.radius, energy.radius + 1) ** 2) / (2 * energy.sigma_px**2))
    return np.outer(along, along)


def _bytes(
    energy: Energy, falloff: NDArray[np.float64], weights: tuple[float, tuple[float, ...]]
) -> NDArray[np.float64]:
    """Weight of each byte, float64 (side, 16 vectors)."""
    pixel = np.zeros(energy.channels)
    pixel[: energy.colours] = weights[0] / energy.colours
    pixel[energy.colours : energy.colours + len(weights[1])] = weights[1]
    rows = np.zeros((energy.side, 16 * energy.vectors))
    rows[:, : energy.side * energy.channels] = (falloff[:, :, None] * pixel).reshape(energy.side, -1)
    return rows


def _scale(weights: NDArray[np.float64]) -> float:
    """The largest scale of the weights at which no 32-bit sum and no 16-bit product overflows."""
    lanes = weights.reshape(len(weights), -1, _LANES, 2).sum((0, 1, 3))
    by_sum = math.sqrt(0.9 * _MAX_SUM / (255**2 * max(float(lanes.max()), 1e-9)))
    return min(by_sum, _MAX_SCALE / math.sqrt(max(float(weights.max()), 1e-9)))


@cache
def cosines() -> NDArray[np.float32]:
    """(cos, sin) of each rotation between two directions, float32 (64, 2); rotations are in (-90, 90] degrees."""
    steps = np.arange(DIRECTIONS)
    angles = np.where(steps > DIRECTIONS // 2, steps - DIRECTIONS, steps) * (np.pi / DIRECTIONS)
    return np.ascontiguousarray(np.stack([np.cos(angles), np.sin(angles)], -1), np.float32)


@cache
def taps(radius: int) -> NDArray[np.int32]:
    """Positions of the patch taps in the style for each rotation: (64, side, side, 2), (x, y) px from the centre."""
    span = np.arange(-radius, radius + 1, dtype=np.float32)
    dx, dy = np.meshgrid(span, span)
    c, s = (part[:, None, None] for part in cosines().T)
    return np.stack([np.rint(c * dx - s * dy), np.rint(s * dx + c * dy)], -1).astype(np.int32)


def tap_table(radius: int, rotate: bool) -> Shorts:
    """`taps` in the layout of the coherence term: int16 (rotations, side, 32) with alternating x and y."""
    found = taps(radius)[: DIRECTIONS if rotate else 1]
    out = np.zeros((*found.shape[:2], 32), np.int16)
    out[..., : 2 * found.shape[2]] = found.reshape(*found.shape[:2], -1)
    return out
