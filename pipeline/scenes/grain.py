"""Texture: smooth periodic noise that can be sampled at any position. It depends on the seed alone."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.scenes.pose import Array

TILE = 512
"""Samples along a period."""
_LEVELS = 7


@lru_cache(maxsize=64)
def _tile(seed: int, level: int) -> NDArray[np.float32]:
    """Noise tile with a spectrum of about 1 / f and values of about -1..1; each level halves the bandwidth."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, 0x67726169])))
    spectrum = np.fft.rfft2(random.standard_normal((TILE, TILE)))
    spectrum *= _falling()
    return np.fft.irfft2(spectrum * _passed(level), s=(TILE, TILE)).astype(np.float32)


def _frequency() -> Array:
    """Periods in a tile, of each value of a spectrum: float64 (TILE, TILE / 2 + 1)."""
    frequency: Array = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)) * TILE
    return frequency


@lru_cache(maxsize=1)
def _falling() -> Array:
    """The filter of about 1 / f, shape as `_frequency`; it leaves white noise with values of about -1..1."""
    frequency = _frequency()
    falling = np.where(frequency >= 3, 1.0 / np.maximum(frequency, 1) ** 1.15, 0.0)
    return falling / (2.5 * _deviation(falling))


@lru_cache(maxsize=_LEVELS)
def _passed(level: int) -> Array:
    """The low-pass filter of a level, 0..1, shape as `_frequency`."""
    passed: Array = np.exp(-((_frequency() / (0.25 * TILE / 2**level)) ** 4))
    return passed


def _deviation(falling: Array) -> float:
    """Standard deviation of white noise after this filter; all levels are scaled by it and differ only in detail."""
    both = 2 * np.square(falling).sum() - np.square(falling[:, 0]).sum() - np.square(falling[:, -1]).sum()
    return math.sqrt(both) / TILE


def grain(x: Array, y: Array, period: float, pixel: float, seed: int) -> Array:
    """Noise at (x, y), about -1..1.

    Args:
        x, y: positions, any unit.
        period: period of the noise, in that unit; the coarsest features are a third of it.
        pixel: size of a pixel in that unit; features below about three pixels are removed to avoid aliasing.
        seed: random seed.
    """
    step = period / TILE
    level = min(_LEVELS - 1, max(0, math.ceil(math.log2(max(pixel / step, 1e-9)) - 0.4)))
    return _bilinear(_tile(seed, level), x / step, y / step)


def _bilinear(tile: NDArray[np.float32], x: Array, y: Array) -> Array:
    left, top = np.floor(x), np.floor(y)
    fx, fy = x - left, y - top
    c0, r0 = left.astype(np.int64) % TILE, top.astype(np.int64) % TILE
    c1, r1 = (c0 + 1) % TILE, (r0 + 1) % TILE
    upper = tile[r0, c0] * (1 - fx) + tile[r0, c1] * fx
    lower = tile[r1, c0] * (1 - fx) + tile[r1, c1] * fx
    mixed: Array = upper * (1 - fy) + lower * fy
    return mixed
