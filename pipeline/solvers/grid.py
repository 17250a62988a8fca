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

from pipeline.kernels.jit import kernel
from pipeline.solvers.coarsen import coarse_stencil, interpolation_weights
from pipeline.solvers.lines import factor_lines, sweep

Doubles: TypeAlias = NDArray[np.float64]
"""float64 array; near convergence, residuals are small differences of large numbers."""


_STENCIL, _LINES, _WEIGHTS = slice(0, 5), slice(5, 9), slice(9, 13)
"""Planes of a grid, each (h + 2, w + 2): the matrix; factors of the line smoother, see `factor_lines`; interpolation
weights from the next coarser grid."""
_PLANES = 13
_RIGHT, _X, _WORK_PLANES = 0, 1, 2
"""Planes of the work arrays of a grid: right-hand side, solution; their padding stays zero."""


@dataclass(frozen=True)
class Levels:
    """All grids from the finest to a single pixel; sizes are halved and rounded up.

    They share one array, so that one call of a kernel visits all of them: a V-cycle on a few thousand pixels takes less
    time than forty calls.

    Attributes:
        planes: the planes of all grids, one grid after the other.
        sizes: int64 (levels, 2), padded height and width of each grid.
    """

    planes: Doubles
    sizes: NDArray[np.int64]

    @property
    def stencil(self) -> Doubles:
        """The matrix of the finest grid, (5, h + 2, w + 2)."""
        height, width = self.sizes[0]
        return self.planes[: 5 * height * width].reshape(5, height, width)


def build_levels(stencil: Doubles) -> Levels:
    """Build all grids from the finest, given by its stencil, (5, h + 2, w + 2)."""
    sizes = [(stencil.shape[1] - 2, stencil.shape[2] - 2)]
    while sizes[-1] != (1, 1):
        sizes.append(((sizes[-1][0] + 1) // 2, (sizes[-1][1] + 1) // 2))
    padded = np.array(sizes, np.int64) + 2
    planes = np.zeros(_PLANES * int(padded.prod(axis=1).sum()))
    planes[: stencil.size] = stencil.reshape(-1)
    _build(planes, padded)
    return Levels(planes, padded)


def work_arrays(levels: Levels) -> Doubles:
    """Allocate the work arrays of all grids; each solving thread needs its own."""
    return np.zeros(_WORK_PLANES * int(levels.sizes.prod(axis=1).sum()))


def finest(levels: Levels, work: Doubles, plane: int) -> Doubles:
    """Plane `RIGHT_SIDE` or `SOLUTION` of the finest grid's work arrays: (h + 2, w + 2)."""
    height, width = levels.sizes[0]
    return work[plane * height * width : (plane + 1) * height * width].reshape(height, width)


RIGHT_SIDE, SOLUTION = _RIGHT, _X


def v_cycle(levels: Levels, work: Doubles) -> None:
    """Run one V(1, 1)-cycle from 0: right-hand side of the finest grid -> its approximate solution. The operator is
    symmetric."""
    _v_cycle(levels.planes, levels.sizes, work)


@kernel
def _grid(flat: Doubles, count: int, at: int, size: NDArray[np.int64]) -> Doubles:
    """The `count` planes of a grid from place `at` on."""
    return flat[at : at + count * size[0] * size[1]].reshape((count, size[0], size[1]))


@kernel
def _build(planes: Doubles, sizes: NDArray[np.int64]) -> None:
    at = 0
    for level in range(len(sizes)):
        own = _grid(planes, _PLANES, at, sizes[level])
        at += own.size
        factor_lines(own[_STENCIL], own[_LINES])
        if level + 1 < len(sizes):
            interpolation_weights(own[_STENCIL], own[_WEIGHTS])
            coarse_stencil(own[_STENCIL], own[_WEIGHTS], _grid(planes, _PLANES, at, sizes[level + 1])[_STENCIL])


@kernel
def _v_cycle(planes: Doubles, sizes: NDArray[np.int64], work: Doubles) -> None:
    last, at = len(sizes) - 1, 0
    for level in range(last + 1):
        cells = sizes[level, 0] * sizes[level, 1]
        own = _grid(planes, _PLANES, _PLANES * at, sizes[level])
        here = _grid(work, _WORK_PLANES, _WORK_PLANES * at, sizes[level])
        here[_X] = 0.0
        sweep(own[_STENCIL], own[_LINES], here[_RIGHT], here[_X], 0)
        at += cells
        if level < last:
            coarse = _grid(work, _WORK_PLANES, _WORK_PLANES * at, sizes[level + 1])
            coarse[_RIGHT] = 0.0
            restrict(own[_STENCIL], own[_WEIGHTS], here[_RIGHT], here[_X], coarse[_RIGHT])
    for level in range(last - 1, -1, -1):
        at -= sizes[level + 1, 0] * sizes[level + 1, 1]
        coarse = _grid(work, _WORK_PLANES, _WORK_PLANES * at, sizes[level + 1])
        before = at - sizes[level, 0] * sizes[level, 1]
        own = _grid(planes, _PLANES, _PLANES * before, sizes[level])
        here = _grid(work, _WORK_PLANES, _WORK_PLANES * before, sizes[level])
        interpolate(own[_WEIGHTS], coarse[_X], here[_X])
        sweep(own[_STENCIL], own[_LINES], here[_RIGHT], here[_X], 1)


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
