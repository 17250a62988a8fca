"""Texture: smooth periodic noise, sampled anywhere, the same for a seed on any machine."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from pipeline.scenes.pose import Array

TILE = 512
"""Samples along a period."""
_LEVELS = 7


@lru_cache(maxsize=32)
def _tiles(seed: int) -> tuple[Array, ...]:
    """Noise with a spectrum that falls as 1 / f, about -1..1; each level has half the detail of the one before."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, 0x67726169])))
    spectrum = np.fft.rfft2(random.standard_normal((TILE, TILE)))
    frequency = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)) * TILE
    falling = np.where(frequency >= 3, 1.0 / np.maximum(frequency, 1) ** 1.15, 0.0)
    finest = [0.25 * TILE / 2**level for level in range(_LEVELS)]
    tiles = [np.fft.irfft2(spectrum * falling * np.exp(-((frequency / f) ** 4)), s=(TILE, TILE)) for f in finest]
    return tuple(tile / (2.5 * tiles[0].std()) for tile in tiles)


def grain(x: Array, y: Array, period: float, pixel: float, seed: int) -> Array:
    """Noise at (x, y), about -1..1.

    Args:
        x, y: positions, any unit.
        period: after how much it repeats, in that unit; its coarsest features are a third of that.
        pixel: size of a pixel in that unit; detail finer than some three pixels is left out, so nothing aliases.
        seed: which noise.
    """
    step = period / TILE
    level = min(_LEVELS - 1, max(0, math.ceil(math.log2(max(pixel / step, 1e-9)) - 0.4)))
    return _bilinear(_tiles(seed)[level], x / step, y / step)


def _bilinear(tile: Array, x: Array, y: Array) -> Array:
    left, top = np.floor(x), np.floor(y)
    fx, fy = x - left, y - top
    c0, r0 = left.astype(np.int64) % TILE, top.astype(np.int64) % TILE
    c1, r1 = (c0 + 1) % TILE, (r0 + 1) % TILE
    upper = tile[r0, c0] * (1 - fx) + tile[r0, c1] * fx
    lower = tile[r1, c0] * (1 - fx) + tile[r1, c1] * fx
    mixed: Array = upper * (1 - fy) + lower * fy
    return mixed
