"""Distance transforms, and fields that go on beyond what they are known of."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device
from pipeline.frames import Mask, Plane
from pipeline.segmentation.jit import kernel

_SOURCE = Path(__file__).with_suffix(".cl")
_FAR_PX = 46340
Values = TypeVar("Values", bound="NDArray[np.generic]")
Sites = NDArray[np.int32]
"""The nearest set pixel of each, int32 (h, w, 2): (x, y), (-1, -1) = there is none."""


def nearest(mask: Mask, device: Device | None = None, reach_px: int = _FAR_PX) -> Sites:
    """Each pixel's nearest one that is True: exact, Euclidean; of two as near the left one, then the upper one.

    Args:
        mask: bool (h, w).
        device: where to compute; None = the reference. The choice changes nothing.
        reach_px: farther ones are not looked for.
    """
    most = min(reach_px, _FAR_PX) ** 2 + 1
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
    """Distance to the nearest pixel that is True, px, float32 (h, w); where none is, the image's diagonal."""
    sites = nearest(mask, device)
    height, width = mask.shape
    x, y = np.arange(width, dtype=np.int64), np.arange(height, dtype=np.int64)[:, None]
    squares = (sites[..., 0] - x) ** 2 + (sites[..., 1] - y) ** 2
    squares[sites[..., 0] < 0] = width**2 + height**2
    return np.sqrt(squares.astype(np.float32))


def extrapolated(field: Values, sites: Sites) -> Values:
    """A field that holds where something is known, gone on outside: each pixel has the value of its site, 0 = no site.

    Source: benard2013stylizing, section 4: velocities carry paint beyond the outline.

    Args:
        field: (h, w) or (h, w, channels).
        sites: `nearest` of the mask of what is known.
    """
    found = field[sites[..., 1], sites[..., 0]]
    found[sites[..., 0] < 0] = 0
    return cast(Values, np.ascontiguousarray(found))


def within(sites: Sites, reach_px: float) -> Mask:
    """Where the nearest known pixel is at most so far, bool (h, w)."""
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
