"""Lines that hold still: hysteresis over whole strokes and a memory along the motion (ours, beyond the paper).

Lines drawn afresh each frame are most of a cartoon's flicker: a response near its threshold turns a stroke on and off.
Here a stroke needs a strong response somewhere to be born and a weak one to live, short strokes are not drawn, and
ink fades in and out over a few frames while it moves with the picture.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.segmentation.jit import kernel


def keep_strokes(
    ink: Plane, before: Plane | None, importance: Plane, weak: float, strong: float, shortest_px: float
) -> NDArray[np.bool_]:  # fmt: skip
    """Which pixels belong to a stroke worth drawing: bool (h, w).

    A stroke is a connected run of ink above `weak`; it is kept when it reaches `strong` or lies on ink that was
    drawn `before` (float32 (h, w), moved to this frame), and is at least `shortest_px` pixels large: a third of
    that if it was drawn before, and a quarter where it matters most (an eye is short), importance float32 (h, w).
    """
    mask = (ink > weak).astype(np.uint8)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_32S)
    past = before if before is not None else np.zeros_like(ink)
    peak, old, weight = _strongest(np.asarray(parts, np.int32), ink, past, importance, count)
    known = old > 0.25 * np.maximum(stats[:, cv2.CC_STAT_AREA], 1)
    extent = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    long_enough = extent >= shortest_px * np.where(known, 1 / 3, 1) * (1 - 0.75 * weight)
    keep: NDArray[np.bool_] = ((peak > strong) | known) & long_enough
    keep[0] = False
    return np.asarray(keep[parts], np.bool_)


@kernel
def _strongest(
    parts: NDArray[np.int32], ink: Plane, before: Plane, importance: Plane, count: int
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]]:  # fmt: skip
    peak = np.zeros(count, np.float32)
    old = np.zeros(count, np.int32)
    weight = np.zeros(count, np.float32)
    height, width = ink.shape
    for y in range(height):
        for x in range(width):
            part = parts[y, x]
            if part:
                peak[part] = max(peak[part], ink[y, x])
                weight[part] = max(weight[part], importance[y, x])
                old[part] += before[y, x] > 0.3
    return peak, old, weight


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
