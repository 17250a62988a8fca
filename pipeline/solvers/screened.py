"""Screened Poisson equation on the pixel grid, to the accuracy of 8-bit pictures: a coarse solve, then relaxation.

    a_i x_i  +  sum over the four neighbours j of (x_i - x_j)  =  b_i

`Multigrid` solves it exactly, with costs that a video at camera rate cannot afford. Here it solves the equation on a
grid of a sixteenth of the size, which settles all smooth parts of x. From there, each solution is interpolated to twice
the size and settled by damped Jacobi iterations, up to the size of the picture (a cascadic multigrid). These
converge fast wherever `a` is not small.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.buffers import Buffers
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.solvers.multigrid import Multigrid

SWEEPS = {"whole": 4, "half": 2, "quarter": 2, "eighth": 3}
"""Jacobi iterations at the size of the picture and at parts of it; the next smaller equation is solved."""
COARSE_TOLERANCE = 1e-2
"""Relative residual of the coarse solution: its error is below that of interpolating it."""
DAMPING = 0.8

Field = NDArray[np.float32]


def solve_screened(
    absorb: Plane, source: Field, buffers: Buffers | None = None, background: FrameExecutor = INLINE
) -> Field:  # fmt: skip
    """Solve the equation for all channels of `source`, with Neumann borders.

    Args:
        absorb: the terms a >= 0, float32 (h, w). Where a = 0, the solution is interpolated from the surroundings;
            where a = 0 everywhere, x = 0.
        source: the terms b, float32 (h, w, channels).
        buffers: working memory. It contains the solution until the next call with the same `buffers`.
        background: may take rows of a sweep.

    Returns:
        x, float32 (h, w, channels).
    """
    buffers = Buffers() if buffers is None else buffers
    levels = [(absorb, np.ascontiguousarray(source, np.float32))]
    for _ in SWEEPS:
        levels.append(_halved(*levels[-1]))
    x = _solved(*levels.pop())
    for (a, b), sweeps, name in reversed(list(zip(levels, SWEEPS.values(), SWEEPS, strict=True))):
        x = _relaxed(a, b, x, sweeps, (buffers, name), background)
    return x


def _halved(absorb: Plane, source: Field) -> tuple[Plane, Field]:
    """The equation for pixels of twice the side; a last odd row or column becomes part of the one before."""
    size = (-(-absorb.shape[1] // 2), -(-absorb.shape[0] // 2))
    a = cv2.resize(absorb, size, interpolation=cv2.INTER_AREA) * np.float32(4)
    b = cv2.resize(source, size, interpolation=cv2.INTER_AREA) * np.float32(4)
    return np.asarray(a, np.float32), np.asarray(b, np.float32).reshape(size[1], size[0], -1)


def _solved(absorb: Plane, source: Field) -> Field:
    """The solution of the coarsest equation."""
    planes = np.moveaxis(source, -1, 0)
    system = Multigrid(np.zeros(absorb.shape, np.bool_), absorb=absorb)
    x = system.solve(np.zeros(planes.shape), source=planes, tolerance=COARSE_TOLERANCE).x
    return np.ascontiguousarray(np.moveaxis(x, 0, -1))


def _relaxed(
    absorb: Plane, source: Field, coarse: Field, sweeps: int, memory: tuple[Buffers, str], background: FrameExecutor
) -> Field:  # fmt: skip
    """The solution `coarse`, interpolated to the shape of `source` and relaxed."""
    (height, width, channels), (buffers, name) = source.shape, memory
    padded = (height + 2, (width + 2) * channels)
    now, other = buffers.get(f"{name} x", padded), buffers.get(f"{name} next x", padded)
    inner = slice(1, -1), slice(channels, -channels)
    start = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
    now[inner] = start.reshape(height, width * channels)
    factor = buffers.get(f"{name} diagonal", (height, width * channels))
    background.rows(lambda *span: _inverse_diagonal(absorb, channels, factor, *span), height)
    right = source.reshape(height, width * channels)

    def relax(first: int, last: int) -> None:
        rows, padded_rows = slice(first, last), slice(first, last + 2)
        _relax(now[padded_rows], right[rows], factor[rows], channels, other[padded_rows])

    for _ in range(sweeps):
        background.rows(relax, height)
        now, other = other, now
    return now[inner].reshape(source.shape)


@kernel
def _inverse_diagonal(absorb: Any, channels: int, factor: Any, first_row: int, end_row: int) -> None:
    """Fill rows of `factor` with 1 / (a + number of neighbours), repeated for each channel: float32
    (h, w * channels)."""
    height, width = absorb.shape
    for y in range(first_row, end_row):
        neighbours = 4 - (y == 0) - (y == height - 1)
        for x in range(width):
            edges = neighbours - (x == 0) - (x == width - 1)
            value = np.float32(1) / max(absorb[y, x] + np.float32(edges), np.float32(1e-6))
            for c in range(channels):
                factor[y, x * channels + c] = value


@kernel
def _relax(x: Any, right: Any, factor: Any, channels: int, out: Any) -> None:
    """One damped Jacobi iteration from `x` to `out`, whose rows are interleaved channels and which have a border of
    one pixel of zeros."""
    height, width = factor.shape
    keep, take = np.float32(1 - DAMPING), np.float32(DAMPING)
    begin, end = channels, channels + width
    for y in range(height):
        row, above, below = x[y + 1, begin:end], x[y, begin:end], x[y + 2, begin:end]
        left, after = x[y + 1, :width], x[y + 1, 2 * channels :]
        b, f, o = right[y], factor[y], out[y + 1, begin:end]
        for j in range(width):
            o[j] = keep * row[j] + take * f[j] * (b[j] + left[j] + after[j] + above[j] + below[j])
