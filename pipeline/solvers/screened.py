"""Screened Poisson equation on the pixel grid, to the accuracy of 8-bit pictures: a coarse solve, then relaxation.

    a_i x_i  +  sum over the four neighbours j of (x_i - x_j)  =  b_i

`Multigrid` solves it exactly, with costs that a video at camera rate cannot afford. Here it solves the equation on a
grid of a quarter of the size, which settles all smooth parts of x; damped Jacobi iterations settle the fine parts,
which converge fast wherever `a` is not small.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.jit import kernel
from pipeline.solvers.multigrid import Multigrid

COARSE = 4
"""Edge length of a coarse pixel, px."""
SWEEPS = 4
COARSE_TOLERANCE = 1e-2
"""Relative residual of the coarse solution: its error is below that of interpolating it."""
DAMPING = 0.8

Field = NDArray[np.float32]


def solve_screened(absorb: Plane, source: Field) -> Field:
    """Solve the equation for all channels of `source`, with Neumann borders.

    Args:
        absorb: the terms a >= 0, float32 (h, w). Where a = 0, the solution is interpolated from the surroundings;
            where a = 0 everywhere, x = 0.
        source: the terms b, float32 (h, w, channels).

    Returns:
        x, float32 (h, w, channels).
    """
    x = np.ascontiguousarray(_coarse(absorb, source))
    rows = (x.shape[0], x.shape[1] * x.shape[2])
    now, other, right = x.reshape(rows), np.empty(rows, np.float32), np.ascontiguousarray(source).reshape(rows)
    factor = _inverse_diagonal(absorb, x.shape[2])
    for _ in range(SWEEPS):
        _relax(now, right, factor, x.shape[2], other)
        now, other = other, now
    return now.reshape(x.shape)


def _coarse(absorb: Plane, source: Field) -> Field:
    """The solution of the coarse equation, interpolated to the shape of `source`."""
    height, width = absorb.shape
    size = (-(-width // COARSE), -(-height // COARSE))
    scale = np.float32(COARSE * COARSE)
    a = cv2.resize(absorb, size, interpolation=cv2.INTER_AREA) * scale
    b = cv2.resize(source, size, interpolation=cv2.INTER_AREA).reshape(*a.shape, -1) * scale
    planes = np.moveaxis(b, -1, 0)
    system = Multigrid(np.zeros(a.shape, np.bool_), absorb=a)
    x = system.solve(np.zeros(planes.shape), source=planes, tolerance=COARSE_TOLERANCE).x
    fine = cv2.resize(np.ascontiguousarray(np.moveaxis(x, 0, -1)), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine, np.float32).reshape(source.shape)


def _inverse_diagonal(absorb: Plane, channels: int) -> NDArray[np.float32]:
    """1 / (a + number of neighbours), repeated for each channel: float32 (h, w * channels)."""
    diagonal = absorb + np.float32(4)
    for edge in (diagonal[0], diagonal[-1], diagonal[:, 0], diagonal[:, -1]):
        edge -= 1
    return np.repeat(1 / diagonal, channels, axis=1)


@kernel
def _relax(x: Any, right: Any, factor: Any, channels: int, out: Any) -> None:
    """One damped Jacobi iteration from `x` to `out`; rows are interleaved channels."""
    height, width = x.shape
    keep, take = np.float32(1 - DAMPING), np.float32(DAMPING)
    for i in range(height):
        row, above, below = x[i], x[max(i - 1, 0)], x[min(i + 1, height - 1)]
        up, down = np.float32(i > 0), np.float32(i < height - 1)
        for j in range(channels):
            total = right[i, j] + row[j + channels] + up * above[j] + down * below[j]
            out[i, j] = keep * row[j] + take * total * factor[i, j]
        for j in range(channels, width - channels):
            total = right[i, j] + row[j - channels] + row[j + channels] + up * above[j] + down * below[j]
            out[i, j] = keep * row[j] + take * total * factor[i, j]
        for j in range(width - channels, width):
            total = right[i, j] + row[j - channels] + up * above[j] + down * below[j]
            out[i, j] = keep * row[j] + take * total * factor[i, j]
