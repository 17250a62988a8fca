"""Bristle texture: a tileable noise that is nearly constant along a stroke and varies across it."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.strokes.random import KEPT_TEXTURES, Ids, Purpose, draws

ACROSS, ALONG = 64, 256
"""Size of the tile in texels, across and along a stroke; both are powers of two."""
SUBROWS = 4
"""Interpolated rows of `fine_tile` for each row of `tile`."""

Tile = NDArray[np.float32]
"""Seamlessly repeating noise in 0..1, `float32` (ACROSS, ALONG)."""


class BristleArgs(NamedTuple):
    """Bristle texture as the compiled rasterisers take it.

    Attributes:
        tile: from `tile` or `fine_tile`.
        offsets: int32 (n,), each stroke's own position in the tile: row in the low six bits, column above.
    """

    tile: Tile
    offsets: NDArray[np.int32]


def bristle_args(noise: Tile, ids: Ids, seed: int) -> BristleArgs:
    """Give each stroke a random position in the tile, which depends on its id alone."""
    unit = draws(ids, seed, Purpose.BRISTLES)[:, 0]
    return BristleArgs(noise, (unit * np.float32(1 << 16)).astype(np.int32))


@lru_cache(maxsize=KEPT_TEXTURES)
def tile(seed: int = 0) -> Tile:
    """Make the bristle texture of one brush. The array is read-only."""
    noise = draws(np.arange(ACROSS * ALONG, dtype=np.uint64), seed, Purpose.BRISTLES)[:, 0].reshape(ACROSS, ALONG)
    fine = _smooth(noise, 0.7, 14.0)
    broad = _smooth(np.ascontiguousarray(noise[::-1]), 2.5, 30.0)
    out = _equalize(fine + 0.8 * broad)
    out.setflags(write=False)
    return out


def _smooth(noise: Tile, across: float, along: float) -> Tile:
    wide = np.pad(noise, 64, mode="wrap")
    smooth = cv2.GaussianBlur(wide, (0, 0), sigmaX=along, sigmaY=across)[64:-64, 64:-64]
    return np.asarray((smooth - smooth.mean()) / smooth.std(), np.float32)


def _equalize(values: Tile) -> Tile:
    """Histogram equalisation to 0..1: low and high texels are equally frequent."""
    order = np.argsort(values, axis=None, kind="stable")
    out = np.empty(values.size, np.float32)
    out[order] = (np.arange(values.size, dtype=np.float32) + np.float32(0.5)) / np.float32(values.size)
    return out.reshape(values.shape)


@kernel
def hair(tile: Tile, s_px: np.float32, t: np.float32, radius_px: np.float32, across: int, along: int) -> np.float32:
    """Read the texture, 0..1, at `s_px` along and `t` in -1..1 across a stroke; one bristle is about 0.7 px wide.

    `across` and `along` are the stroke's own offset in the tile, in texels.
    """
    row = int(np.float32(2048.0) + t * radius_px * np.float32(2.0)) + across
    column = int(np.float32(8192.0) + s_px * np.float32(1.5)) + along
    value: np.float32 = tile[row & 63, column & 255]
    return value


@lru_cache(maxsize=KEPT_TEXTURES)
def fine_tile(seed: int = 0) -> Tile:
    """`tile` with linearly interpolated rows, float32 (SUBROWS * ACROSS, ALONG). The array is read-only."""
    rough = tile(seed)
    after = np.roll(rough, -1, axis=0)
    parts = (np.arange(SUBROWS, dtype=np.float32) / np.float32(SUBROWS))[:, None, None]
    rows = rough + parts * (after - rough)
    out = np.ascontiguousarray(rows.transpose(1, 0, 2).reshape(SUBROWS * ACROSS, ALONG), np.float32)
    out.setflags(write=False)
    return out


@kernel
def soft_hair(fine: Tile, column: np.float32, row: np.float32, across: int, along: int) -> np.float32:
    """Read `fine_tile`, 0..1, at `row` tile rows from the stroke's centre line; sub-rows avoid flicker under motion."""
    place = int(np.float32(8192.0) + row * np.float32(SUBROWS)) + across * SUBROWS
    value: np.float32 = fine[place & 255, (int(np.float32(8192.0) + column) + along) & 255]
    return value
