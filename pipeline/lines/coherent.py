"""Temporal coherence of lines: hysteresis over whole strokes, and warping along the flow.

Independent line extraction flickers: a response near the threshold switches a stroke on and off from frame to frame.
Here a stroke appears only where the response is strong somewhere, and stays while it is weak; short strokes are not
drawn; ink fades in and out over a few frames while it moves along the flow. Departure: this is not part of
zhang2011online.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel

Ink: TypeAlias = NDArray[np.uint8]
"""Opacity of ink, uint8 (h, w), 0..255."""
RUN = np.dtype([("row", np.int32), ("start", np.int32), ("stop", np.int32), ("parent", np.int32)])
"""Horizontal run of ink pixels: columns [start, stop) of a row, and an earlier run of the same stroke or itself."""
STROKE = np.dtype([
    ("left", np.int32), ("top", np.int32), ("right", np.int32), ("bottom", np.int32), ("peak", np.int32),
    ("importance", np.int32), ("area", np.int32), ("drawn_before", np.int32),
])  # fmt: skip
"""A stroke: bounding box, px, inclusive; strongest ink and largest importance, 0..255; area in px, and how many of
these pixels lie on ink that was drawn in the previous frame."""


class StrokeParams(NamedTuple):
    """Constants of the choice of strokes."""

    drawn: int = 76
    """Ink above this value counts as drawn in the previous frame."""
    many_short_strokes: float = 10.0
    largest_factor: float = 3.0
    """Number of short strokes in nine cells above which strokes there must be longer, in proportion to that number,
    and the largest factor. Without it, foliage and grass would be full of specks. The single short stroke of an eye
    stays."""
    far: np.int32 = np.int32(1 << 30)


STROKES = StrokeParams()


class PreviousInk(NamedTuple):
    """Ink of the previous frame, and the motion since.

    Attributes:
        ink: uint8 (h, w).
        flow: previous to current frame, float32 (h, w, 2), px.
    """

    ink: Ink
    flow: Flow


class StrokeLimits(NamedTuple):
    """Which strokes are drawn.

    Attributes:
        weak, strong: hysteresis thresholds on ink, 0..255: of all pixels of a stroke, and of its strongest pixel.
        shortest_px: smallest extent of a stroke. The limit is a third of it for strokes that were drawn before, and
            falls to a quarter where importance is 1, since an eye is short. It rises where short strokes are many
            (`STROKES.many_short_strokes`).
    """

    weak: int
    strong: int
    shortest_px: float


def keep_strokes(ink: Ink, past: PreviousInk | None, importance: Plane, limits: StrokeLimits) -> NDArray[np.uint8]:
    """Select the pixels of the strokes to draw: uint8 (h, w), 255 or 0.

    A stroke is a connected set of pixels with ink above `limits.weak`. It is drawn if it is long enough, and either
    reaches `limits.strong` or was drawn before on more than a quarter of its area.

    Args:
        past: ink of the previous frame; None = a shot begins.
        importance: float32 (h, w), 0..1.
    """
    if past is None:
        past = PreviousInk(np.zeros_like(ink), np.zeros((*ink.shape, 2), np.float32))
    out = np.zeros(ink.shape, np.uint8)
    runs = np.empty(ink.shape[0] * (ink.shape[1] + 1) // 2, RUN)
    count = _find_runs(ink, limits.weak, runs)
    _draw_strokes(ink, past, importance, limits, runs[:count], np.zeros(count, STROKE), out)
    return out


@kernel
def _draw_strokes(
    ink: Ink, past: PreviousInk, importance: Plane, limits: StrokeLimits, runs: NDArray[np.void],
    strokes: NDArray[np.void], out: NDArray[np.uint8],
) -> None:  # fmt: skip
    """`strokes`: one record per run, initially zero; only those of root runs are used."""
    for k in range(runs.size):
        strokes[k]["left"] = strokes[k]["top"] = STROKES.far
    for k in range(runs.size):
        runs[k]["parent"] = _root(runs, k)
        _add_run(runs[k], ink, past, importance, strokes[runs[k]["parent"]])
    short = _count_short(runs, strokes, limits.shortest_px, ink.shape)
    for k in range(runs.size):
        stroke = strokes[runs[k]["parent"]]
        if _is_drawn(stroke, limits, _length_factor(stroke, short, limits.shortest_px)):
            out[runs[k]["row"], runs[k]["start"] : runs[k]["stop"]] = 255


@kernel
def _find_runs(ink: Ink, weak: int, runs: NDArray[np.void]) -> int:
    """Write the runs of ink above `weak` in raster order and join touching ones; returns their number."""
    height, width = ink.shape
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
            runs[count]["row"], runs[count]["start"], runs[count]["stop"] = y, start, x
            runs[count]["parent"] = count
            while above < first and runs[above]["stop"] < start:  # too far left even for diagonal contact
                above += 1
            k = above
            while k < first and runs[k]["start"] <= x:
                _join(runs, k, count)
                k += 1
            count += 1
        above = first
    return count


@kernel
def _root(runs: NDArray[np.void], k: int) -> int:
    while runs[k]["parent"] != k:
        runs[k]["parent"] = runs[runs[k]["parent"]]["parent"]
        k = runs[k]["parent"]
    return k


@kernel
def _join(runs: NDArray[np.void], one: int, two: int) -> None:
    one, two = _root(runs, one), _root(runs, two)
    runs[max(one, two)]["parent"] = min(one, two)


@kernel
def _add_run(run: np.void, ink: Ink, past: PreviousInk, importance: Plane, stroke: np.void) -> None:
    """Add a run to its stroke."""
    height, width = ink.shape
    y, start, stop = run["row"], run["start"], run["stop"]
    stroke["left"], stroke["right"] = min(stroke["left"], start), max(stroke["right"], stop - 1)
    stroke["top"], stroke["bottom"] = min(stroke["top"], y), max(stroke["bottom"], y)
    stroke["area"] += stop - start
    peak, weight, known = stroke["peak"], np.float32(0), 0
    for x in range(start, stop):
        peak = max(peak, np.int32(ink[y, x]))
        weight = max(weight, importance[y, x])
        i = min(max(x - int(np.rint(past.flow[y, x, 0])), 0), width - 1)
        j = min(max(y - int(np.rint(past.flow[y, x, 1])), 0), height - 1)
        known += past.ink[j, i] > STROKES.drawn
    stroke["peak"] = peak
    stroke["importance"] = max(stroke["importance"], int(weight * 255))
    stroke["drawn_before"] += known


@kernel
def _count_short(
    runs: NDArray[np.void], strokes: NDArray[np.void], shortest_px: float, shape: tuple[int, int]
) -> NDArray[np.int32]:
    """Number of short strokes by cell, with an empty cell on every side. Cells are twice `shortest_px` wide; a stroke
    of a third to twice that length is short."""
    side = max(2 * shortest_px, 1.0)
    out = np.zeros((int(shape[0] / side) + 3, int(shape[1] / side) + 3), np.int32)
    for k in range(runs.size):
        if runs[k]["parent"] == k and shortest_px <= 3 * _extent(strokes[k]) and _extent(strokes[k]) < side:
            row, column = _cell(strokes[k], side)
            out[row, column] += 1
    return out


@kernel
def _length_factor(stroke: np.void, short: NDArray[np.int32], shortest_px: float) -> float:
    """Factor on the smallest extent of a stroke: 1, and up to `STROKES.largest_factor` among many short strokes."""
    row, column = _cell(stroke, max(2 * shortest_px, 1.0))
    total = 0
    for j in range(row - 1, row + 2):
        for i in range(column - 1, column + 2):
            total += short[j, i]
    return min(max(total / STROKES.many_short_strokes, 1.0), STROKES.largest_factor)


@kernel
def _cell(stroke: np.void, side: float) -> tuple[int, int]:
    """Row and column of the cell in which a stroke's bounding box has its middle."""
    return (
        int((stroke["top"] + stroke["bottom"]) / (2 * side)) + 1,
        int((stroke["left"] + stroke["right"]) / (2 * side)) + 1,
    )


@kernel
def _extent(stroke: np.void) -> int:
    longer: int = max(stroke["right"] - stroke["left"], stroke["bottom"] - stroke["top"]) + 1
    return longer


@kernel
def _is_drawn(stroke: np.void, limits: StrokeLimits, length_factor: float) -> bool:
    known = stroke["drawn_before"] * 4 > stroke["area"]
    shortest = (
        limits.shortest_px * length_factor * (1 / 3 if known else 1.0) * (1 - 0.75 * (stroke["importance"] / 255))
    )
    strong_enough: bool = stroke["peak"] > limits.strong or known
    return strong_enough and _extent(stroke) >= shortest


def warp_forward(plane: Plane, flow: Flow) -> Plane:
    """Move a plane of the previous frame to the current one, bilinear: float32 (h, w).

    Args:
        flow: float32 (h, w, 2), previous to current frame, px; positions outside are clamped to the border.
    """
    out = np.empty_like(plane)
    _advect(plane, flow, out)
    return out


@kernel
def _advect(plane: Plane, flow: Flow, out: Plane) -> None:
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
