"""Matrices of the multigrid levels, and the operations of a V-cycle: residual, restriction, interpolation.

Every array is padded by one pixel of zeros on each side, so that loops need no boundary checks. A stencil is symmetric
and stores each coupling once, with positive sign, in the planes `CENTRE`, `EAST`, `SOUTH`, `SOUTH_EAST`, `SOUTH_WEST`.
The row of a given pixel is zero, so it is not coupled to any other.

A pixel with padded coordinates (y, x) is on the coarse grid if both are odd. Interpolation weights have one plane per
corner of the coarse cell that contains the pixel: `NW`, `NE`, `SW`, `SE`. Pixels with fewer corners use the planes of
those corners only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.jit import kernel
from pipeline.solvers.coarsen import coarse_stencil, interpolation_weights
from pipeline.solvers.lines import factor_lines, sweep

Doubles: TypeAlias = NDArray[np.float64]
"""float64 array; near convergence, residuals are small differences of large numbers."""


@dataclass(frozen=True)
class Level:
    """One grid.

    Attributes:
        stencil: the matrix, (5, h + 2, w + 2).
        lines: factors of the line smoother, (4, h + 2, w + 2), see `factor_lines`.
        weights: interpolation weights from the next coarser grid, (4, h + 2, w + 2).
    """

    stencil: Doubles
    lines: Doubles
    weights: Doubles

    @property
    def shape(self) -> tuple[int, int]:
        return self.stencil.shape[1], self.stencil.shape[2]


def build_levels(stencil: Doubles) -> list[Level]:
    """Build all grids from the finest, given by its stencil, to a single pixel; sizes are halved and rounded up."""
    levels = []
    while True:
        height, width = stencil.shape[1] - 2, stencil.shape[2] - 2
        weights = np.zeros((4, height + 2, width + 2))
        levels.append(Level(stencil, factor_lines(stencil), weights))
        if height == width == 1:
            return levels
        interpolation_weights(stencil, weights)
        coarse = np.zeros((5, (height + 1) // 2 + 2, (width + 1) // 2 + 2))
        coarse_stencil(stencil, weights, coarse)
        stencil = coarse


@dataclass(frozen=True)
class WorkArrays:
    """Work arrays of a V-cycle on one grid: right-hand side and solution; the padding stays zero."""

    right: Doubles
    x: Doubles


def work_arrays(levels: list[Level]) -> list[WorkArrays]:
    """Allocate work arrays for each grid; each solving thread needs its own."""
    return [WorkArrays(np.zeros(level.shape), np.zeros(level.shape)) for level in levels]


def v_cycle(levels: list[Level], work: list[WorkArrays]) -> None:
    """Run one V(1, 1)-cycle from 0: `work[0].right` -> approximate solution `work[0].x`. The operator is symmetric."""
    level, here = levels[0], work[0]
    here.x.fill(0.0)
    sweep(level.stencil, level.lines, here.right, here.x, 0)
    if len(levels) == 1:
        return
    work[1].right.fill(0.0)
    restrict(level.stencil, level.weights, here.right, here.x, work[1].right)
    v_cycle(levels[1:], work[1:])
    interpolate(level.weights, work[1].x, here.x)
    sweep(level.stencil, level.lines, here.right, here.x, 1)


@kernel
def restrict(stencil: Doubles, weights: Doubles, right: Doubles, x: Doubles, coarse: Doubles) -> None:
    """Restrict the residual to the coarse grid by the transpose of the interpolation."""
    centre, east, south, south_east, south_west = stencil
    height, width = x.shape
    row = np.zeros(width)
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            total = right[i, j] + east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
            total += south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
            total += south_east[i, j] * x[i + 1, j + 1] + south_east[i - 1, j - 1] * x[i - 1, j - 1]
            total += south_west[i, j] * x[i + 1, j - 1] + south_west[i - 1, j + 1] * x[i - 1, j + 1]
            row[j] = total - centre[i, j] * x[i, j]
        top, below = (i + 1) // 2, i // 2 + 1
        for j in range(1, width - 1):
            left, beyond = (j + 1) // 2, j // 2 + 1
            coarse[top, left] += weights[0, i, j] * row[j]
            if beyond > left:
                coarse[top, beyond] += weights[1, i, j] * row[j]
            if below > top:
                coarse[below, left] += weights[2, i, j] * row[j]
                if beyond > left:
                    coarse[below, beyond] += weights[3, i, j] * row[j]


@kernel
def interpolate(weights: Doubles, coarse: Doubles, x: Doubles) -> None:
    """Add the interpolated correction of the coarse grid to `x`, in place."""
    height, width = x.shape
    for i in range(1, height - 1):
        top, below = (i + 1) // 2, i // 2 + 1
        for j in range(1, width - 1):
            left, beyond = (j + 1) // 2, j // 2 + 1
            upper = weights[0, i, j] * coarse[top, left] + weights[1, i, j] * coarse[top, beyond]
            lower = weights[2, i, j] * coarse[below, left] + weights[3, i, j] * coarse[below, beyond]
            x[i, j] += upper + lower


@kernel
def multiply(stencil: Doubles, x: Doubles, out: Doubles) -> float:
    """Compute `out` = A x; return the dot product of x and A x."""
    centre, east, south, south_east, south_west = stencil
    height, width = x.shape
    result = 0.0
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            near = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
            near += south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
            near += south_east[i, j] * x[i + 1, j + 1] + south_east[i - 1, j - 1] * x[i - 1, j - 1]
            near += south_west[i, j] * x[i + 1, j - 1] + south_west[i - 1, j + 1] * x[i - 1, j + 1]
            out[i, j] = centre[i, j] * x[i, j] - near
            result += x[i, j] * out[i, j]
    return result


@kernel
def dot(a: Doubles, b: Doubles) -> float:
    """Dot product, summed in a fixed order; a multithreaded library may sum in varying order."""
    height, width = a.shape
    result = 0.0
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            result += a[i, j] * b[i, j]
    return result


@kernel
def advance(x: Doubles, residual: Doubles, direction: Doubles, image: Doubles, step: float) -> float:
    """Take a conjugate gradient step along `direction`, where `image` = A `direction`; return the squared residual
    norm."""
    height, width = x.shape
    result = 0.0
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            x[i, j] += step * direction[i, j]
            residual[i, j] -= step * image[i, j]
            result += residual[i, j] * residual[i, j]
    return result


@kernel
def conjugate(direction: Doubles, better: Doubles, part: float) -> None:
    """Update the search direction, in place: preconditioned residual `better` plus `part` times the last direction."""
    height, width = direction.shape
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            direction[i, j] = better[i, j] + part * direction[i, j]
