"""Smoothing of gradients in the analysed frame, where a codec has left steps between its blocks.

A compressed sky or wall has a small step at every block of 8 or 16 px. Segmentation divides a gradient where its colour
crosses a threshold; because of the steps, the border follows the blocks. Here the mean colours of square cells are
diffused between neighbouring cells that differ little. A pixel whose surrounding cells are all flat takes their
interpolated colour. Cells with an edge or texture, and the cells next to them, do not change.

Departure: this is not part of zhang2011online.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import LabPlanes
from pipeline.frames import Plane
from pipeline.kernels.jit import kernel


class ShadingParams(NamedTuple):
    """Constants of the smoothing of gradients."""

    cell_px: int = 8
    """Side of a cell, px, equal to that of the smallest block of a codec."""
    measured_rows: tuple[int, int, int, int] = (0, 2, 5, 7)
    """Rows of a cell that are measured, symmetric about its middle. They suffice, because the frame has been
    blurred."""
    flat_below: np.float32 = np.float32(6)
    uneven_from: np.float32 = np.float32(10)
    """Range of a cell's colours, 8-bit CIELAB levels. A cell below `flat_below` is smoothed fully, one from
    `uneven_from` on is not smoothed."""
    largest_step: np.float32 = np.float32(8)
    """Difference of two cells' mean colours, 8-bit CIELAB levels, at and above which nothing is diffused between
    them."""
    passes: int = 8
    share: np.float32 = np.float32(0.24)
    """Number of diffusion passes, and the largest share of a difference that moves in a pass: together a Gaussian
    with a standard deviation of 2 cells."""
    largest_change: np.float32 = np.float32(4)
    """Largest change of a pixel, 8-bit CIELAB levels."""


SHADING = ShadingParams()


Cells = NDArray[np.float32]
"""float32 (3, rows, columns): mean L, a, b of every cell, 8-bit levels."""


def smooth_shading(lab: LabPlanes) -> None:
    """Smooth the gradients of a frame between its edges, in place.

    Args:
        lab: uint8 (3, h, w), 8-bit CIELAB.
    """
    height, width = lab.shape[1:]
    shape = (-(-height // SHADING.cell_px), -(-width // SHADING.cell_px))
    means, flatness = np.empty((3, *shape), np.float32), np.empty(shape, np.float32)
    _measure_cells(lab, means, flatness)
    if flatness.any():
        _interpolate(_diffused(means, flatness), _pixel_weights(means, flatness), lab)


@kernel
def _measure_cells(lab: LabPlanes, means: Cells, flatness: Plane) -> None:
    """Write the mean colour and the flatness, 0..1, of every cell, measured on `SHADING.measured_rows`."""
    height, width = lab.shape[1], lab.shape[2]
    total, least, most = np.empty(width, np.int32), np.empty(width, np.uint8), np.empty(width, np.uint8)
    flatness[:] = 1
    for plane in range(3):
        for row in range(flatness.shape[0]):
            top, bottom = row * SHADING.cell_px, min((row + 1) * SHADING.cell_px, height)
            total[:], least[:], most[:] = 0, 255, 0
            count = 0
            for offset in SHADING.measured_rows:
                if top + offset >= bottom:
                    break
                count += 1
                line = lab[plane, top + offset]
                for x in range(width):  # this vectorises
                    total[x] += np.int32(line[x])
                    least[x] = min(least[x], line[x])
                    most[x] = max(most[x], line[x])
            for column in range(flatness.shape[1]):
                left, right = column * SHADING.cell_px, min((column + 1) * SHADING.cell_px, width)
                level, low, high = np.int32(0), np.uint8(255), np.uint8(0)
                for x in range(left, right):
                    level += total[x]
                    low, high = min(low, least[x]), max(high, most[x])
                means[plane, row, column] = np.float32(level) / np.float32(count * (right - left))
                flatness[row, column] = min(flatness[row, column], _evenness(np.float32(high - low)))


@kernel
def _diffused(means: Cells, flatness: Plane) -> Cells:
    """Mean colours diffused between flat cells whose colours differ by less than `SHADING.largest_step`."""
    rows, columns = flatness.shape
    right, below = np.zeros((rows, columns), np.float32), np.zeros((rows, columns), np.float32)
    for y in range(rows):
        for x in range(columns):
            if x + 1 < columns:
                right[y, x] = _conductance(means, flatness, y, x, y, x + 1)
            if y + 1 < rows:
                below[y, x] = _conductance(means, flatness, y, x, y + 1, x)
    now = means.copy()
    change = np.empty((rows, columns), np.float32)
    for _ in range(SHADING.passes):
        for plane in range(3):
            level = now[plane]
            change[:] = 0
            for y in range(rows):
                for x in range(columns - 1):
                    flow = right[y, x] * (level[y, x + 1] - level[y, x])
                    change[y, x] += flow
                    change[y, x + 1] -= flow
            for y in range(rows - 1):
                for x in range(columns):
                    flow = below[y, x] * (level[y + 1, x] - level[y, x])
                    change[y, x] += flow
                    change[y + 1, x] -= flow
            for y in range(rows):
                for x in range(columns):
                    level[y, x] += change[y, x]
    return now


@kernel
def _step(means: Cells, y: int, x: int, j: int, i: int) -> np.float32:
    """Largest difference of two cells' mean L, a or b."""
    step = np.float32(0)
    for plane in range(3):
        step = max(step, np.abs(means[plane, y, x] - means[plane, j, i]))
    return step


@kernel
def _conductance(means: Cells, flatness: Plane, y: int, x: int, j: int, i: int) -> np.float32:
    """Share of the difference between two neighbouring cells that moves in one pass."""
    both = min(flatness[y, x], flatness[j, i])
    alike = max(np.float32(1) - _step(means, y, x, j, i) / SHADING.largest_step, np.float32(0))
    return np.float32(SHADING.share * both * alike)


@kernel
def _evenness(span: np.float32) -> np.float32:
    """1 for a range of colours below `SHADING.flat_below`, 0 from `SHADING.uneven_from` on."""
    return min(
        max((SHADING.uneven_from - span) / (SHADING.uneven_from - SHADING.flat_below), np.float32(0)), np.float32(1)
    )


@kernel
def _pixel_weights(means: Cells, flatness: Plane) -> Plane:
    """Weight of the diffused colours at each cell, 0..1: the least flatness of the cell and its eight neighbours.

    The difference between cells counts, too: with an edge exactly between them, two cells are both flat.
    """
    rows, columns = flatness.shape
    out = np.empty_like(flatness)
    for y in range(rows):
        for x in range(columns):
            least = flatness[y, x]
            for j in range(max(y - 1, 0), min(y + 2, rows)):
                for i in range(max(x - 1, 0), min(x + 2, columns)):
                    if least > 0:
                        least = min(least, flatness[j, i], _evenness(_step(means, y, x, j, i)))
            out[y, x] = least
    return out


@kernel
def _interpolate(means: Cells, weights: Plane, lab: LabPlanes) -> None:
    """Move each pixel towards the bilinear interpolation of the cells around it, by their interpolated weights."""
    rows, columns = weights.shape
    row, share = np.empty(columns + 2, np.float32), np.empty((columns + 1) * SHADING.cell_px, np.float32)
    smooth = np.empty_like(share)
    for y in range(lab.shape[1]):
        place = (np.float32(y) + np.float32(0.5)) / np.float32(SHADING.cell_px) - np.float32(0.5)
        upper = int(np.floor(place))
        part = place - np.float32(upper)
        above, below = max(upper, 0), min(upper + 1, rows - 1)
        _mix_rows(weights[above], weights[below], part, row)
        first, last = 0, columns + 1
        while first <= last and row[first] == 0:
            first += 1
        while last > first and row[last] == 0:
            last -= 1
        if first > last:
            continue
        first, last = max(first - 1, 0), min(last + 1, columns + 1)
        _stretch(row[first : last + 1], share)
        left = first * SHADING.cell_px - SHADING.cell_px // 2
        right = min((last * SHADING.cell_px) - SHADING.cell_px // 2, lab.shape[2])
        skipped = max(-left, 0)
        for plane in range(3):
            _mix_rows(means[plane, above], means[plane, below], part, row)
            _stretch(row[first : last + 1], smooth)
            _approach(lab[plane, y, left + skipped : right], smooth[skipped:], share[skipped:])


@kernel
def _mix_rows(one: NDArray[np.float32], two: NDArray[np.float32], part: np.float32, out: NDArray[np.float32]) -> None:
    """Write the interpolation of two rows of cells, with the first and the last value repeated once."""
    count = one.size
    for k in range(count):
        out[k + 1] = one[k] + part * (two[k] - one[k])
    out[0], out[count + 1] = out[1], out[count]


@kernel
def _stretch(row: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Write the linear interpolation between the centres of cells: `SHADING.cell_px` values for each pair of
    neighbours."""
    for column in range(row.size - 1):
        first, step = row[column], (row[column + 1] - row[column]) / np.float32(SHADING.cell_px)
        for k in range(SHADING.cell_px):
            out[column * SHADING.cell_px + k] = first + step * (np.float32(k) + np.float32(0.5))


@kernel
def _approach(line: NDArray[np.uint8], smooth: NDArray[np.float32], share: NDArray[np.float32]) -> None:
    for x in range(line.size):  # this vectorises
        level = np.float32(line[x])
        change = min(max(smooth[x] - level, -SHADING.largest_change), SHADING.largest_change)
        line[x] = np.uint8(np.int32(level + share[x] * change + np.float32(0.5)))
