"""Operator-dependent interpolation and Galerkin coarse grids (dendy1982black).

A pixel between two coarse pixels is interpolated with weights proportional to its couplings to either side; a pixel
between four is interpolated by its own equation. Values therefore do not cross weak edges or given pixels on any grid.
The coarse matrix is P' A P.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel

Doubles: TypeAlias = NDArray[np.float64]


@kernel
def interpolation_weights(stencil: Doubles, weights: Doubles) -> None:
    """Fill `weights` (4, h + 2, w + 2), zeros before: between two pixels >= 0, and at most 1 together."""
    centre, east, south, south_east, south_west = stencil
    height, width = centre.shape
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            if i % 2 == 1 and j % 2 == 1:
                weights[0, i, j] = 1.0 if centre[i, j] > 0 else 0.0
            elif i % 2 == 1:
                one = max(0.0, east[i, j - 1] + south_east[i - 1, j - 1] + south_west[i, j])
                other = max(0.0, east[i, j] + south_west[i - 1, j + 1] + south_east[i, j])
                whole = max(one + other, centre[i, j] - south[i - 1, j] - south[i, j])
                if whole > 0:
                    weights[0, i, j], weights[1, i, j] = one / whole, other / whole
            elif j % 2 == 1:
                one = max(0.0, south[i - 1, j] + south_east[i - 1, j - 1] + south_west[i - 1, j + 1])
                other = max(0.0, south[i, j] + south_east[i, j] + south_west[i, j])
                whole = max(one + other, centre[i, j] - east[i, j - 1] - east[i, j])
                if whole > 0:
                    weights[0, i, j], weights[2, i, j] = one / whole, other / whole
    for i in range(2, height - 1, 2):
        for j in range(2, width - 1, 2):
            if centre[i, j] > 0:
                _amid_four(stencil, weights, i, j)


@kernel
def _amid_four(stencil: Doubles, weights: Doubles, i: int, j: int) -> None:
    centre, east, south, south_east, south_west = stencil
    up, down, left, right = south[i - 1, j], south[i, j], east[i, j - 1], east[i, j]
    scale = 1.0 / centre[i, j]
    nw = south_east[i - 1, j - 1] + up * weights[0, i - 1, j] + left * weights[0, i, j - 1]
    ne = south_west[i - 1, j + 1] + up * weights[1, i - 1, j] + right * weights[0, i, j + 1]
    sw = south_west[i, j] + down * weights[0, i + 1, j] + left * weights[2, i, j - 1]
    se = south_east[i, j] + down * weights[1, i + 1, j] + right * weights[2, i, j + 1]
    weights[0, i, j], weights[1, i, j] = nw * scale, ne * scale
    weights[2, i, j], weights[3, i, j] = sw * scale, se * scale


@kernel
def coarse_stencil(stencil: Doubles, weights: Doubles, out: Doubles) -> None:
    """Add P' A P to `out` (5, h' + 2, w' + 2), initially zero, one row of A at a time."""
    centre, east, south, south_east, south_west = stencil
    height, width = centre.shape
    row = np.zeros((3, 3))
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            if centre[i, j] > 0:
                row[:] = 0.0
                _add_entry(-south_east[i - 1, j - 1], (i - 1, j - 1), (i, j), weights, row)
                _add_entry(-south[i - 1, j], (i - 1, j), (i, j), weights, row)
                _add_entry(-south_west[i - 1, j + 1], (i - 1, j + 1), (i, j), weights, row)
                _add_entry(-east[i, j - 1], (i, j - 1), (i, j), weights, row)
                _add_entry(centre[i, j], (i, j), (i, j), weights, row)
                _add_entry(-east[i, j], (i, j + 1), (i, j), weights, row)
                _add_entry(-south_west[i, j], (i + 1, j - 1), (i, j), weights, row)
                _add_entry(-south[i, j], (i + 1, j), (i, j), weights, row)
                _add_entry(-south_east[i, j], (i + 1, j + 1), (i, j), weights, row)
                _add_outer(weights, i, j, row, out)


@kernel
def _add_entry(a: float, at: tuple[int, int], pixel: tuple[int, int], weights: Doubles, row: Doubles) -> None:
    """Add entry `a` of the matrix, for the pixel `at` in the row of `pixel`, to that row of A P; `row` covers the 3 x 3
    coarse pixels from (i // 2, j // 2) on."""
    if a != 0.0:
        (y, x), (i, j) = at, pixel
        top, below = (y + 1) // 2 - i // 2, y // 2 + 1 - i // 2
        left, beyond = (x + 1) // 2 - j // 2, x // 2 + 1 - j // 2
        row[top, left] += a * weights[0, y, x]
        if beyond > left:
            row[top, beyond] += a * weights[1, y, x]
        if below > top:
            row[below, left] += a * weights[2, y, x]
            if beyond > left:
                row[below, beyond] += a * weights[3, y, x]


@kernel
def _add_outer(weights: Doubles, i: int, j: int, row: Doubles, out: Doubles) -> None:
    """Add the outer product of the pixel's weights and the row; each pair of coarse pixels is added once."""
    for corner in range(4):
        weight = weights[corner, i, j]
        if weight != 0.0:
            y = i // 2 + 1 if corner >= 2 else (i + 1) // 2
            x = j // 2 + 1 if corner % 2 == 1 else (j + 1) // 2
            at_y, at_x = y - i // 2, x - j // 2
            out[0, y, x] += weight * row[at_y, at_x]
            if at_x < 2:
                out[1, y, x] -= weight * row[at_y, at_x + 1]
            if at_y < 2:
                out[2, y, x] -= weight * row[at_y + 1, at_x]
                if at_x < 2:
                    out[3, y, x] -= weight * row[at_y + 1, at_x + 1]
                if at_x > 0:
                    out[4, y, x] -= weight * row[at_y + 1, at_x - 1]
