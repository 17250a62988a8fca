"""Exact Euclidean distance transforms, and extrapolation of fields beyond the region where they are known."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device
from pipeline.frames import Mask, Plane
from pipeline.kernels.jit import kernel

_SOURCE = Path(__file__).with_suffix(".cl")
_MAX_DISTANCE_PX = 46340
"""Largest distance whose square fits into 32 bits, px."""
Values = TypeVar("Values", bound="NDArray[np.generic]")
Sites = NDArray[np.int32]
"""Position (x, y) of the nearest True pixel for each pixel, int32 (h, w, 2); (-1, -1) = no such pixel."""


def nearest(mask: Mask, device: Device | None = None, reach_px: int = _MAX_DISTANCE_PX) -> Sites:
    """The nearest True pixel of each pixel: exact Euclidean distance; ties go to the left, then to the upper pixel.

    Args:
        mask: bool (h, w).
        device: compute device; None = the reference implementation. Both have the same result.
        reach_px: maximum distance of the search, px.
    """
    most = min(reach_px, _MAX_DISTANCE_PX) ** 2 + 1
    marked = np.ascontiguousarray(mask, np.uint8)
    height, width = marked.shape
    if device is None:
        out = np.empty((height, width, 2), np.int32)
        _nearest(_columns(marked), out, most)
        return out
    rows, found = device.empty((height, width), np.int32), device.empty((height, width, 2), np.int32)
    device.kernel(_SOURCE, "columns")((width,), device.upload(marked), rows, width, height)
    device.kernel(_SOURCE, "nearest")((width, height), rows, found, most, width, height)
    return device.download(found)


def distance(mask: Mask, device: Device | None = None) -> Plane:
    """Distance to the nearest True pixel, px, float32 (h, w); the image's diagonal if no pixel is True."""
    sites = nearest(mask, device)
    height, width = mask.shape
    x, y = np.arange(width, dtype=np.int64), np.arange(height, dtype=np.int64)[:, None]
    squares = (sites[..., 0] - x) ** 2 + (sites[..., 1] - y) ** 2
    squares[sites[..., 0] < 0] = width**2 + height**2
    return np.sqrt(squares.astype(np.float32))


def extrapolated(field: Values, sites: Sites) -> Values:
    """Extrapolate a field: each pixel receives the value of its nearest known pixel, or 0 if it has none.

    Source: benard2013stylizing, section 4: velocities are extrapolated so that paint beyond the outline moves too.

    Args:
        field: (h, w) or (h, w, channels).
        sites: result of `nearest` for the mask of known pixels.
    """
    found = field[sites[..., 1], sites[..., 0]]
    found[sites[..., 0] < 0] = 0
    return cast(Values, np.ascontiguousarray(found))


def within_reach(sites: Sites, reach_px: float) -> Mask:
    """Mask of the pixels whose nearest known pixel is at most `reach_px` px away, bool (h, w)."""
    height, width = sites.shape[:2]
    x, y = np.arange(width, dtype=np.int64), np.arange(height, dtype=np.int64)[:, None]
    near: Mask = (sites[..., 0] - x) ** 2 + (sites[..., 1] - y) ** 2 <= reach_px**2
    return near & (sites[..., 0] >= 0)


@kernel
def _columns(marked: NDArray[np.uint8]) -> NDArray[np.int32]:
    height, width = marked.shape
    rows = np.empty((height, width), np.int32)
    for x in range(width):
        last = -1
        for y in range(height):
            last = y if marked[y, x] else last
            rows[y, x] = last
        last = -1
        for y in range(height - 1, -1, -1):
            last = y if marked[y, x] else last
            above = rows[y, x]
            if last >= 0 and (above < 0 or last - y < y - above):
                rows[y, x] = last
    return rows


@kernel
def _nearest(rows: NDArray[np.int32], out: Sites, most: int) -> None:
    height, width = rows.shape
    for y in range(height):
        for x in range(width):
            best, found_x, found_y, far = most, -1, -1, 0
            while far < width and far * far < best:
                for side in range(2 if far else 1):
                    column = x + far if side else x - far
                    if column < 0 or column >= width or rows[y, column] < 0:
                        continue
                    square = far * far + (rows[y, column] - y) ** 2
                    if square < best:
                        best, found_x, found_y = square, column, rows[y, column]
                far += 1
            out[y, x, 0], out[y, x, 1] = found_x, found_y
