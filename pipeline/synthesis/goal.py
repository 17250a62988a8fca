"""The goal function's weights, and the tables that its kernels and its reference share.

Eq. 1 and 2 of benard2013stylizing: a patch's cost is a sum over its taps, weighted by a Gaussian, of differences of
output colours, guides and offsets, plus terms of the centre alone. Colours and guides are bytes; their differences are
multiplied by whole numbers (the square roots of the weights, scaled) and squared, so that the sum is exact in 32 bit
integers, in any order, on any processor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

TURNS = 64
"""Directions are steps of a half turn: 2.8 degrees, a quarter of a pixel at the rim of a 9x9 patch."""
NO_DIRECTION = 255
SCALE_SHIFT = 4
STEP_SCALE = 16
_LANES, _MOST = 8, 2**32 - 1
_MOST_WEIGHT, _MOST_SCALE = 42.0, 32.0

Shorts: TypeAlias = NDArray[np.int16]


@dataclass(frozen=True)
class Goal:
    """Weights of the terms of eq. 2 and 10, against squared gray levels (0..255), and their shapes.

    A guide's weight is shared by its channels, as is that of the output colour.
    """

    colours: int = 3
    """Channels of the output: 3, or 4 where it has opacity."""
    radius: int = 4
    """Patches are 2 radius + 1 px wide."""
    sigma_px: float = 3.0
    w_out: float = 1.0
    guides: tuple[float, ...] = (1.0,)
    """Weight of each guide CHANNEL (w_in)."""
    w_sc: float = 0.0
    """Per px^2."""
    r_max_px2: float = 16.0
    w_tc: float = 0.0
    w_h: float = 0.0
    """Per use of an offset beyond the limit (h_s in one)."""
    h_limit: float = 1.0
    """h_tau, as a multiple of how often each pixel of the style would be used if all were alike."""
    w_dt: float = 0.0
    """Per px^2."""
    d_max_px: float = 10.0
    w_din: float = 0.0
    """Of the guides' change, relative to their own weight."""
    w_dout: float = 0.0

    @property
    def side(self) -> int:
        return 2 * self.radius + 1

    @property
    def pad(self) -> int:
        """How far a turned patch reaches."""
        return math.ceil(self.radius * math.sqrt(2.0))

    @property
    def channels(self) -> int:
        """Bytes a pixel: colours and guides, filled up so that a vector holds whole pixels."""
        needed = self.colours + len(self.guides)
        return next(size for size in (4, 8, 16) if needed <= size)

    @property
    def vectors(self) -> int:
        """Vectors of 16 bytes a row of a patch."""
        return -(-self.side * self.channels // 16)

    @property
    def keyed(self) -> bool:
        return self.w_din > 0 or self.w_dout > 0


MOST_GUIDES = 12


@dataclass(frozen=True)
class Tables:
    """What a goal comes to in whole numbers."""

    weights: Shorts
    """(side, 16 vectors): multiplier of each byte of a patch's rows."""
    keyed: Shorts
    """The same for the terms of eq. 10."""
    unit: float
    """Cost of a squared gray level at the centre, of weight 1."""
    centre: float
    """Cost of 1 in a term of the centre alone: the patch's weights together (eq. 2 sums it over the patch)."""
    step_weights: NDArray[np.int32]
    """(side, 16): weight of each tap of a row in eq. 5."""


@cache
def tables(goal: Goal) -> Tables:
    """The tables of a goal."""
    falloff = _falloff(goal)
    plain = _bytes(goal, falloff, (goal.w_out, goal.guides))
    keyed = _bytes(goal, falloff, (goal.w_dout, tuple(goal.w_din * w for w in goal.guides)))
    scale = _scale(plain, keyed)
    unit = scale**2 / (1 << SCALE_SHIFT)
    steps = np.zeros((goal.side, 16), np.int32)
    steps[:, : goal.side] = np.rint(falloff * STEP_SCALE)
    whole = tuple(np.rint(scale * np.sqrt(w)).astype(np.int16) for w in (plain, keyed))
    return Tables(whole[0], whole[1], unit, float(falloff.sum()) * unit, steps)


def _falloff(goal: Goal) -> NDArray[np.float64]:
    along = np.exp(-(np.arange(-goal.radius, goal.radius + 1) ** 2) / (2 * goal.sigma_px**2))
    return np.outer(along, along)


def _bytes(goal: Goal, falloff: NDArray[np.float64], weights: tuple[float, tuple[float, ...]]) -> NDArray[np.float64]:
    """(side, 16 vectors) weight of each byte."""
    pixel = np.zeros(goal.channels)
    pixel[: goal.colours] = weights[0] / goal.colours
    pixel[goal.colours : goal.colours + len(weights[1])] = weights[1]
    rows = np.zeros((goal.side, 16 * goal.vectors))
    rows[:, : goal.side * goal.channels] = (falloff[:, :, None] * pixel).reshape(goal.side, -1)
    return rows


def _scale(plain: NDArray[np.float64], keyed: NDArray[np.float64]) -> float:
    """The finest at which no lane of 32 bits overflows, nor a product of 16: differences of eq. 10 reach 3 x 255."""
    lanes = (plain + 9 * keyed).reshape(len(plain), -1, _LANES, 2).sum((0, 1, 3))
    by_sum = math.sqrt(0.9 * _MOST / (255**2 * max(float(lanes.max()), 1e-9)))
    by_product = _MOST_WEIGHT / math.sqrt(max(float(plain.max()), float(keyed.max()), 1e-9))
    return min(by_sum, by_product, _MOST_SCALE / math.sqrt(max(float(plain.max()), 1e-9)))


@cache
def cosines() -> NDArray[np.float32]:
    """(cos, sin) of each turn, the smallest angle that brings two directions together: (-90, 90] degrees."""
    steps = np.arange(TURNS)
    angles = np.where(steps > TURNS // 2, steps - TURNS, steps) * (np.pi / TURNS)
    return np.ascontiguousarray(np.stack([np.cos(angles), np.sin(angles)], -1), np.float32)


@cache
def taps(radius: int) -> NDArray[np.int32]:
    """Where the taps of a patch lie in the style for each turn: (64, side, side, 2), (x, y) px from the centre."""
    span = np.arange(-radius, radius + 1, dtype=np.float32)
    dx, dy = np.meshgrid(span, span)
    c, s = (part[:, None, None] for part in cosines().T)
    return np.stack([np.rint(c * dx - s * dy), np.rint(s * dx + c * dy)], -1).astype(np.int32)


def steps_table(radius: int, rotate: bool) -> Shorts:
    """`taps` as the coherence term reads them: (turns, side, 32) shorts, x and y in turn."""
    found = taps(radius)[: TURNS if rotate else 1]
    out = np.zeros((*found.shape[:2], 32), np.int16)
    out[..., : 2 * found.shape[2]] = found.reshape(*found.shape[:2], -1)
    return out
