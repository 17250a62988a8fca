"""Lines that hold still: hysteresis over whole strokes and a memory along the motion (ours, beyond the paper).

Lines drawn afresh each frame are most of a cartoon's flicker: a response near its threshold turns a stroke on and off.
Here a stroke needs a strong response somewhere to be born and a weak one to live, short strokes are not drawn, and
ink fades in and out over a few frames while it moves with the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.jit import kernel

Ink: TypeAlias = NDArray[np.uint8]
"""Opacity of ink, uint8 (h, w), 0..255."""
LEFT, TOP, RIGHT, BOTTOM, PEAK, WEIGHT, AREA, KNOWN = range(8)
"""Columns of the table of strokes."""
ROW, START, STOP, PART = range(4)
"""Columns of the list of runs."""
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
    if past is None:
        past = Past(np.zeros_like(ink), np.zeros((1, 1, 2), np.float32), 0)
    out = np.zeros(ink.shape, np.uint8)
    _keep(ink, past.ink, past.flow, past.shrink, importance, weak, strong, shortest_px, out)
    return out


@kernel
def _keep(
    ink: Ink, before: Ink, flow: Flow, shrink: int, importance: Plane, weak: int, strong: int, shortest_px: float,
    out: NDArray[np.uint8],
) -> None:  # fmt: skip
    runs = _runs(ink, weak)
    strokes = np.zeros((runs.shape[0], 8), np.int32)
    strokes[:, LEFT] = strokes[:, TOP] = 1 << 30
    for k in range(runs.shape[0]):
        runs[k, PART] = _root(runs, k)
        _survey(runs[k], ink, before, flow, shrink, importance, strokes[runs[k, PART]])
    for k in range(runs.shape[0]):
        if _worth(strokes[runs[k, PART]], strong, shortest_px):
            out[runs[k, ROW], runs[k, START] : runs[k, STOP]] = 255


@kernel
def _runs(ink: Ink, weak: int) -> NDArray[np.int32]:
    """Runs of ink above `weak` in raster order; a run's `PART` is a run of the same stroke before it, or itself."""
    height, width = ink.shape
    runs = np.empty((height * (width + 1) // 2, 4), np.int32)
    count = above = 0
    for y in range(height):
        row = ink[y]
        first, x = count, 0
        while x < width:
            if row[x] <= weak:
                x += 1
                continue
            start = x
            while x < width and row[x] > weak:
                x += 1
            runs[count, ROW], runs[count, START], runs[count, STOP], runs[count, PART] = y, start, x, count
            while above < first and runs[above, STOP] < start:  # further left than its corners touch
                above += 1
            k = above
            while k < first and runs[k, START] <= x:
                _join(runs, k, count)
                k += 1
            count += 1
        above = first
    return runs[:count]


@kernel
def _root(runs: NDArray[np.int32], k: int) -> int:
    while runs[k, PART] != k:
        runs[k, PART] = runs[runs[k, PART], PART]
        k = runs[k, PART]
    return k


@kernel
def _join(runs: NDArray[np.int32], one: int, two: int) -> None:
    one, two = _root(runs, one), _root(runs, two)
    runs[max(one, two), PART] = min(one, two)


@kernel
def _survey(
    run: NDArray[np.int32], ink: Ink, before: Ink, flow: Flow, shrink: int, importance: Plane,
    stroke: NDArray[np.int32],
) -> None:  # fmt: skip
    """Add a run to its stroke: bounding box, strongest ink, largest importance, pixels, pixels known before."""
    height, width = ink.shape
    y, start, stop = run[ROW], run[START], run[STOP]
    stroke[LEFT], stroke[RIGHT] = min(stroke[LEFT], start), max(stroke[RIGHT], stop - 1)
    stroke[TOP], stroke[BOTTOM] = min(stroke[TOP], y), max(stroke[BOTTOM], y)
    stroke[AREA] += stop - start
    peak, weight, known = stroke[PEAK], np.float32(0), 0
    for x in range(start, stop):
        peak = max(peak, np.int32(ink[y, x]))
        weight = max(weight, importance[y, x])
        if shrink:
            dx, dy = flow[y * shrink, x * shrink, 0], flow[y * shrink, x * shrink, 1]
            i = min(max(x - int(np.rint(dx / shrink)), 0), width - 1)
            j = min(max(y - int(np.rint(dy / shrink)), 0), height - 1)
            known += before[j, i] > DRAWN
    stroke[PEAK] = peak
    stroke[WEIGHT] = max(stroke[WEIGHT], int(weight * 255))
    stroke[KNOWN] += known


@kernel
def _worth(stroke: NDArray[np.int32], strong: int, shortest_px: float) -> bool:
    known = stroke[KNOWN] * 4 > stroke[AREA]
    extent = max(stroke[RIGHT] - stroke[LEFT], stroke[BOTTOM] - stroke[TOP]) + 1
    shortest = shortest_px * (1 / 3 if known else 1.0) * (1 - 0.75 * (stroke[WEIGHT] / 255))
    strong_enough: bool = stroke[PEAK] > strong or known
    return strong_enough and extent >= shortest


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
