"""Lines that hold still: hysteresis over whole strokes and a memory along the motion (ours, beyond the paper).

Lines drawn afresh each frame are most of a cartoon's flicker: a response near its threshold turns a stroke on and off.
Here a stroke needs a strong response somewhere to be born and a weak one to live, short strokes are not drawn, and
ink fades in and out over a few frames while it moves with the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.segmentation.jit import kernel

Ink: TypeAlias = NDArray[np.uint8]
"""Opacity of ink, uint8 (h, w), 0..255."""
LEFT, TOP, RIGHT, BOTTOM, PEAK, WEIGHT, AREA, KNOWN = range(8)
"""Columns of the table of strokes."""
DRAWN = 76
"""Ink above this was seen as drawn."""


@dataclass(frozen=True)
class Past:
    """Ink of the previous frame, and how to find it."""

    ink: Ink
    flow: Flow
    """Previous to current frame at full size, px."""
    shrink: int
    """Full size over the ink's size."""


def keep_strokes(
    ink: Ink, past: Past | None, importance: Plane, weak: int, strong: int, shortest_px: float
) -> NDArray[np.uint8]:  # fmt: skip
    """Which pixels belong to a stroke worth drawing: uint8 (h, w), 255 or 0.

    A stroke is a connected run of ink above `weak` (0..255); it is kept when it reaches `strong` or lies on ink that
    was drawn before, and is at least `shortest_px` pixels large: a third of that if it was drawn before, and a quarter
    where it matters most (an eye is short). `importance` is float32 (h, w).
    """
    count, found = cv2.connectedComponents((ink > weak).view(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    parts = np.asarray(found, np.int32)
    if past is None:
        past = Past(np.zeros_like(ink), np.zeros((1, 1, 2), np.float32), 0)
    strokes = _survey(parts, count, ink, importance, past.ink, past.flow, past.shrink)
    return _pick(parts, _worth(strokes, strong, shortest_px))


@kernel
def _worth(strokes: NDArray[np.int32], strong: int, shortest_px: float) -> NDArray[np.bool_]:
    keep = np.zeros(strokes.shape[0], np.bool_)
    for part in range(1, keep.size):
        row = strokes[part]
        known = row[KNOWN] * 4 > row[AREA]
        extent = max(row[RIGHT] - row[LEFT], row[BOTTOM] - row[TOP]) + 1
        shortest = shortest_px * (1 / 3 if known else 1.0) * (1 - 0.75 * (row[WEIGHT] / 255))
        keep[part] = (row[PEAK] > strong or known) and extent >= shortest
    return keep


@kernel
def _survey(
    parts: NDArray[np.int32], count: int, ink: Ink, importance: Plane, before: Ink, flow: Flow, shrink: int
) -> NDArray[np.int32]:  # fmt: skip
    """The table of strokes: bounding box, strongest ink, largest importance, pixels, pixels known before."""
    strokes = np.zeros((count, 8), np.int32)
    strokes[:, LEFT] = strokes[:, TOP] = 1 << 30
    height, width = ink.shape
    for y in range(height):
        for x in range(width):
            part = parts[y, x]
            if part == 0:
                continue
            row = strokes[part]
            row[0] = min(row[0], x)
            row[1] = min(row[1], y)
            row[2] = max(row[2], x)
            row[3] = max(row[3], y)
            row[4] = max(row[4], ink[y, x])
            row[5] = max(row[5], int(importance[y, x] * 255))
            row[6] += 1
            if shrink:
                dx, dy = flow[y * shrink, x * shrink, 0], flow[y * shrink, x * shrink, 1]
                i = min(max(x - int(np.rint(dx / shrink)), 0), width - 1)
                j = min(max(y - int(np.rint(dy / shrink)), 0), height - 1)
                row[7] += before[j, i] > DRAWN
    return strokes


@kernel
def _pick(parts: NDArray[np.int32], keep: NDArray[np.bool_]) -> NDArray[np.uint8]:
    height, width = parts.shape
    out = np.empty(parts.shape, np.uint8)
    for y in range(height):
        for x in range(width):
            out[y, x] = 255 if keep[parts[y, x]] else 0
    return out


def follow(plane: Plane, flow: Flow) -> Plane:
    """`plane` of the previous frame moved to the current one along `flow` (previous to current, px), float32 (h, w)."""
    out = np.empty_like(plane)
    _follow(plane, flow, out)
    return out


@kernel
def _follow(plane: Plane, flow: Flow, out: Plane) -> None:
    height, width = plane.shape
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            if dx == 0.0 and dy == 0.0:
                out[y, x] = plane[y, x]
                continue
            sx = min(max(x - dx, np.float32(0.0)), np.float32(width - 1))
            sy = min(max(y - dy, np.float32(0.0)), np.float32(height - 1))
            x0, y0 = int(sx), int(sy)
            x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
            fx, fy = np.float32(sx - x0), np.float32(sy - y0)
            top = plane[y0, x0] + fx * (plane[y0, x1] - plane[y0, x0])
            low = plane[y1, x0] + fx * (plane[y1, x1] - plane[y1, x0])
            out[y, x] = top + fy * (low - top)
