"""The windows of a picture in which a cascade is tested: integral images, and the search of one size of windows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.flow.gray import Gray
from pipeline.intrinsics import LANES
from pipeline.jit import kernel_without_overlap
from pipeline.segmentation.stump_votes import Stumps, add_votes

FLAT = 0.1
"""1 / standard deviation of a window's gray levels, from which on it is too flat to be tested."""
REJECTED, TESTED, FAILED = 0, 1, 2
"""States of a window: no further stage tests it; the next stage tests it; the first stage has just rejected it, and the
next window of the row must be rejected with it."""

Image = tuple[NDArray[np.int32], NDArray[np.int32], int]
"""Integral images of a picture and of its squares, flat, and the number of numbers in a row of either."""
Row = tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float64]]
"""Factors of the features of a row's windows, and the windows' states, either with `LANES` spare places; work array of
`LANES` sums of votes."""
Stages = tuple[NDArray[np.int32], Stumps, NDArray[np.int32], NDArray[np.float32]]
"""Corners and stumps as `add_votes` takes them, and the stages of the cascade."""


@kernel_without_overlap
def integrate(picture: Gray, stride: int, step: int, sums: NDArray[np.int32]) -> None:
    """Integral images of a picture and of its squares, which are cut to 32 bits.

    Numbers that neighbouring windows read are neighbours in memory: with windows of every second column, a row has its
    even columns first, and the odd ones from its middle on.

    Args:
        picture: uint8 (h, w).
        stride: numbers in a row; even.
        step: distance of windows, 1 or 2 px.
        sums: int32 (2, at least (h + 1) * stride), receives the result.
    """
    height, width = picture.shape
    sums[:, :stride] = 0
    for y in range(height):
        row = (y + 1) * stride
        total, squares = np.int32(0), np.int32(0)
        sums[0, row], sums[1, row] = 0, 0
        for x in range(1, width + 1):
            value = np.int32(picture[y, x - 1])
            total += value
            squares += value * value
            at = row + _place(x, stride, step)
            sums[0, at] = sums[0, at - stride] + total
            sums[1, at] = sums[1, at - stride] + squares


@kernel_without_overlap
def _place(x: int, stride: int, step: int) -> int:
    return x if step == 1 else (x & 1) * (stride >> 1) + (x >> 1)


@kernel_without_overlap
def search(image: Image, area: tuple[int, int, int, int], stages: Stages, row: Row, found: NDArray[np.int32]) -> int:
    """Find the windows that a cascade accepts.

    Args:
        area: numbers of columns and of rows in which windows start, their distance (1 or 2) and side, px.
        row: memory for a row of windows, the states 0.
        found: int32 (windows, 2), receives their corners (x, y), px.

    Returns:
        Number of windows that were found.
    """
    columns, rows, step, _ = area
    states, windows, count = row[1], (columns + step - 1) // step, 0
    for y in range(0, rows, step):
        _normalise(image, area, y, windows, row)
        _test_first_stage(image, y, windows, stages, row)
        window = 0
        while window < windows:
            if states[window] == REJECTED:
                window += 1
                continue
            _test_other_stages(image, y, window, stages, row)
            for lane in range(min(LANES, windows - window)):
                if states[window + lane] == TESTED:
                    found[count, 0], found[count, 1] = (window + lane) * step, y
                    count += 1
            window += LANES
    return count


@kernel_without_overlap
def _normalise(image: Image, area: tuple[int, int, int, int], y: int, windows: int, row: Row) -> None:
    """Compute the factors of the windows of a row, 1 / (pixels * standard deviation), from all but their outermost
    pixels, and reject the windows that are too flat."""
    sums, squares, stride = image
    factors, states, _ = row
    step, side = area[2:]
    left, right = _place(1, stride, step), _place(side - 1, stride, step)
    a, b = (y + 1) * stride + left, (y + 1) * stride + right
    c, d = (y + side - 1) * stride + left, (y + side - 1) * stride + right
    pixels = np.float64((side - 2) * (side - 2))
    for k in range(windows):
        total = np.float64(np.int32(sums[a + k] - sums[b + k] - sums[c + k] + sums[d + k]))
        square = np.float64(np.uint32(squares[a + k] - squares[b + k] - squares[c + k] + squares[d + k]))
        spread = pixels * square - total * total
        factors[k] = np.float32(1 / np.sqrt(spread)) if spread > 0 else np.float32(1)
        states[k] = TESTED if pixels * np.float64(factors[k]) < FLAT else REJECTED


@kernel_without_overlap
def _test_first_stage(image: Image, y: int, windows: int, stages: Stages, row: Row) -> None:
    """Test the first stage. A window that it rejects also rejects the next one, which is therefore not tested."""
    sums, _, stride = image
    corners, stumps, firsts, needed = stages
    factors, states, votes = row
    for window in range(0, windows, LANES):
        votes[:] = 0
        for stump in range(firsts[1]):
            add_votes(votes, factors, window, sums, y * stride + window, corners, stumps, stump)
        for lane in range(LANES):
            if votes[lane] < needed[0] and states[window + lane] == TESTED:
                states[window + lane] = FAILED
    window = 0
    while window < windows:
        if states[window] == FAILED:
            states[window] = states[window + 1] = REJECTED
            window += 1
        window += 1


@kernel_without_overlap
def _test_other_stages(image: Image, y: int, window: int, stages: Stages, row: Row) -> None:
    """Test the further stages of `LANES` windows, as long as any of them is left."""
    sums, _, stride = image
    corners, stumps, firsts, needed = stages
    factors, states, votes = row
    for stage in range(1, len(needed)):
        votes[:] = 0
        for stump in range(firsts[stage], firsts[stage + 1]):
            add_votes(votes, factors, window, sums, y * stride + window, corners, stumps, stump)
        left = False
        for lane in range(LANES):
            if votes[lane] < needed[stage]:
                states[window + lane] = REJECTED
            left |= states[window + lane] == TESTED
        if not left:
            return
