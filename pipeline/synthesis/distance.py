"""Distance transforms, and fields that go on beyond what they are known of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device
from pipeline.frames import Flow, Mask, Plane
from pipeline.segmentation.jit import kernel

_SOURCE = Path(__file__).with_suffix(".cl")
_FAR = 2**31 - 1
Sites = NDArray[np.int32]
"""The nearest set pixel of each, int32 (h, w, 2): (x, y), (-1, -1) = there is none."""


def nearest(mask: Mask, device: Device | None = None) -> Sites:
    """Each pixel's nearest one that is True: exact, Euclidean; of two as near the left one, then the upper one.

    Args:
        mask: bool (h, w).
        device: where to compute; None = the reference. The choice changes nothing.
    """
    marked = np.ascontiguousarray(mask, np.uint8)
    height, width = marked.shape
    if device is None:
        out = np.empty((height, width, 2), np.int32)
        _nearest(_columns(marked), out)
        return out
    rows, found = device.empty((height, width), np.int32), device.empty((height, width, 2), np.int32)
    device.kernel(_SOURCE, "columns")((width,), device.upload(marked), rows, width, height)
    device.kernel(_SOURCE, "nearest")((width, height), rows, found, width, height)
    return device.download(found)


def distance(mask: Mask, device: Device | None = None) -> Plane:
    """Distance to the nearest pixel that is True, px, float32 (h, w); where none is, the image's diagonal."""
    sites = nearest(mask, device)
    height, width = mask.shape
    x, y = np.arange(width, dtype=np.int64), np.arange(height, dtype=np.int64)[:, None]
    squares = (sites[..., 0] - x) ** 2 + (sites[..., 1] - y) ** 2
    squares[sites[..., 0] < 0] = width**2 + height**2
    return np.sqrt(squares.astype(np.float32))


def extrapolated(field: Flow, known: Mask, device: Device | None = None) -> Flow:
    """A field that holds within `known`, gone on outside: each pixel there has the value of the nearest known one.

    Source: benard2013stylizing, section 4: velocities carry paint beyond the outline. Nothing known: zeros.
    """
    sites = nearest(known, device)
    if not known.any():
        return np.zeros_like(field)
    return np.ascontiguousarray(field[sites[..., 1], sites[..., 0]])


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
def _nearest(rows: NDArray[np.int32], out: Sites) -> None:
    height, width = rows.shape
    for y in range(height):
        for x in range(width):
            best, found_x, found_y, far = _FAR, -1, -1, 0
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
