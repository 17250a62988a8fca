"""The traces of a brush's hairs: noise across a stroke, drawn out along it."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.segmentation.jit import kernel
from pipeline.strokes.random import Purpose, draws

ACROSS, ALONG = 64, 256
"""Size of the tile, a power of two each: texels across and along a stroke."""

Tile = NDArray[np.float32]
"""Noise in 0..1, `float32` (ACROSS, ALONG), that repeats without a seam."""


@cache
def tile(seed: int = 0) -> Tile:
    """The hairs of one brush; every stroke reads it at its own offset. Read-only."""
    noise = draws(np.arange(ACROSS * ALONG, dtype=np.uint64), seed, Purpose.BRISTLES)[:, 0].reshape(ACROSS, ALONG)
    fine = _smooth(noise, 0.7, 14.0)
    broad = _smooth(np.ascontiguousarray(noise[::-1]), 2.5, 30.0)
    out = _spread(fine + 0.8 * broad)
    out.setflags(write=False)
    return out


def _smooth(noise: Tile, across: float, along: float) -> Tile:
    wide = np.pad(noise, 64, mode="wrap")
    smooth = cv2.GaussianBlur(wide, (0, 0), sigmaX=along, sigmaY=across)[64:-64, 64:-64]
    return np.asarray((smooth - smooth.mean()) / smooth.std(), np.float32)


def _spread(values: Tile) -> Tile:
    """The same order, evenly spread over 0..1: as many deep traces as high ones."""
    order = np.argsort(values, axis=None, kind="stable")
    out = np.empty(values.size, np.float32)
    out[order] = (np.arange(values.size, dtype=np.float32) + np.float32(0.5)) / np.float32(values.size)
    return out.reshape(values.shape)


@kernel
def hair(tile: Tile, s_px: np.float32, t: np.float32, radius_px: np.float32, across: int, along: int) -> np.float32:
    """The trace at `s_px` along and `t` in -1..1 across a stroke, 0..1; about a hair per 0.7 px, whatever the radius.

    `across` and `along` are the stroke's own offset in the tile.
    """
    row = int(np.float32(2048.0) + t * radius_px * np.float32(2.0)) + across
    column = int(np.float32(8192.0) + s_px * np.float32(1.5)) + along
    value: np.float32 = tile[row & 63, column & 255]
    return value


BETWEEN = 4
"""Rows of `fine_tile` for one of `tile`."""


@cache
def fine_tile(seed: int = 0) -> Tile:
    """The same hairs, float32 (BETWEEN * ACROSS, ALONG), with rows between the rows. Read-only."""
    rough = tile(seed)
    after = np.roll(rough, -1, axis=0)
    parts = (np.arange(BETWEEN, dtype=np.float32) / np.float32(BETWEEN))[:, None, None]
    rows = rough + parts * (after - rough)
    out = np.ascontiguousarray(rows.transpose(1, 0, 2).reshape(BETWEEN * ACROSS, ALONG), np.float32)
    out.setflags(write=False)
    return out


@kernel
def soft_hair(fine: Tile, column: np.float32, row: np.float32, across: int, along: int) -> np.float32:
    """The trace at `row` rows of `tile` from a stroke's middle line and `column` along it: it hardly trembles."""
    place = int(np.float32(8192.0) + row * np.float32(4.0)) + across * 4
    value: np.float32 = fine[place & 255, (int(np.float32(8192.0) + column) + along) & 255]
    return value
