"""Line Gauss-Seidel smoother in both directions (zebra ordering).

With strongly varying weights, a chain of strong edges among weak ones may contain no coarse pixel; point smoothers then
converge very slowly. A line smoother solves whole rows or columns at once, and is also faster for uniform weights. Each
line is a tridiagonal system, factored in advance. Lines of the same parity are independent of each other.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel

Doubles: TypeAlias = NDArray[np.float64]

LOST = 1e-14
"""Pivots below this fraction of the diagonal are treated as 0: the line is not coupled to anything else."""


TINY = 1e-150
"""Smaller magnitudes are set to 0, since arithmetic with denormal numbers is slow."""


@kernel
def factor_lines(stencil: Doubles, out: Doubles) -> None:
    """Factor all lines into `out` (4, h + 2, w + 2), zeros before: for rows and then for columns, coupling / pivot and
    1 / pivot."""
    _factor(stencil[0], stencil[1], out[:2])
    _factor(stencil[0].T, stencil[2].T, out[2:].transpose((0, 2, 1)))


@kernel
def _factor(centre: Doubles, next_one: Doubles, out: Doubles) -> None:
    height, width = centre.shape
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            pivot = centre[i, j] - next_one[i, j - 1] * out[0, i, j - 1]
            if pivot > LOST * centre[i, j]:
                out[1, i, j] = 1.0 / pivot
                out[0, i, j] = next_one[i, j] / pivot


@kernel
def sweep(stencil: Doubles, factors: Doubles, right: Doubles, x: Doubles, backward: int) -> None:
    """Smooth odd rows, even rows, odd columns, even columns, in place; `backward` reverses this order."""
    for k in range(4):
        half = 3 - k if backward else k
        if half < 2:
            _rows(stencil, factors, right, x, 1 + half)
        else:
            _columns(stencil, factors, right, x, half - 1)


@kernel
def _rows(stencil: Doubles, factors: Doubles, right: Doubles, x: Doubles, first: int) -> None:
    _centre, east, south, south_east, south_west = stencil
    height, width = x.shape
    for i in range(first, height - 1, 2):
        for j in range(1, width - 1):
            total = right[i, j] + south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
            total += south_east[i, j] * x[i + 1, j + 1] + south_east[i - 1, j - 1] * x[i - 1, j - 1]
            total += south_west[i, j] * x[i + 1, j - 1] + south_west[i - 1, j + 1] * x[i - 1, j + 1]
            value = (total + east[i, j - 1] * x[i, j - 1]) * factors[1, i, j]
            x[i, j] = value if abs(value) > TINY else 0.0
        for j in range(width - 2, 0, -1):
            value = x[i, j] + factors[0, i, j] * x[i, j + 1]
            x[i, j] = value if abs(value) > TINY else 0.0


@kernel
def _columns(stencil: Doubles, factors: Doubles, right: Doubles, x: Doubles, first: int) -> None:
    _centre, east, south, south_east, south_west = stencil
    height, width = x.shape
    for i in range(1, height - 1):
        for j in range(first, width - 1, 2):
            total = right[i, j] + east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
            total += south_east[i, j] * x[i + 1, j + 1] + south_east[i - 1, j - 1] * x[i - 1, j - 1]
            total += south_west[i, j] * x[i + 1, j - 1] + south_west[i - 1, j + 1] * x[i - 1, j + 1]
            value = (total + south[i - 1, j] * x[i - 1, j]) * factors[3, i, j]
            x[i, j] = value if abs(value) > TINY else 0.0
    for i in range(height - 2, 0, -1):
        for j in range(first, width - 1, 2):
            value = x[i, j] + factors[2, i, j] * x[i + 1, j]
            x[i, j] = value if abs(value) > TINY else 0.0
