"""Forces of the springs of a region, in kernels: the inner loop of the relaxation (`pipeline.warp.springs`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask, Plane
from pipeline.kernels.jit import kernel

Planes = NDArray[np.float32]
"""float32 (2, h, w): planes of x and y, px."""
Row = tuple[NDArray[np.float32], NDArray[np.float32]]
"""x and y of a row."""
Sums = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
"""Force along x and y, and stiffness, of a row."""


@kernel
def strain(
    laid: Planes, targets: Planes, inside: Mask, stiffness: Plane, rest: np.float32, force: NDArray[np.float32],
    rows: NDArray[np.float32], energies: NDArray[np.float64],
) -> float:  # fmt: skip
    """Compute each pixel's force (half of -dE/dx) and sum of stiffnesses; return the energy.

    Each neighbour spring is visited once, from the first of its pixels in scan order: to the right, and to the three
    neighbours below. A row is visited direction by direction, so that the compiler vectorises the loops.

    Args:
        force: float32 (h, w, 3), receives the forces.
        rows: work array, float32 (7, 3, w): the forces of a row's springs by direction, their sums, and twice the
            forces that a row passes on to the next.
        energies: work array, float64 (w,), energy of each column.
    """
    height, width = inside.shape
    diagonal = rest * np.float32(1.4142135)
    sums = rows[4, 0], rows[4, 1], rows[4, 2]
    rows[5], energies[:] = 0, 0
    for y in range(height):
        row, position = (targets[0, y], targets[1, y]), (laid[0, y], laid[1, y])
        _anchor(row, position, inside[y], stiffness[y], sums, energies)
        for n in range(4 if y + 1 < height else 1):
            below, right = (0, 1) if n == 0 else (1, n - 2)
            a, b = max(0, -right), width - max(0, right)  # pixels with a neighbour there
            c, d = a + right, b + right
            _stretch(
                (laid[0, y, a:b], laid[1, y, a:b]), (laid[0, y + below, c:d], laid[1, y + below, c:d]),
                (inside[y, a:b], inside[y + below, c:d]), rest if n % 2 == 0 else diagonal,
                (rows[n, 0, a:b], rows[n, 1, a:b], rows[n, 2, a:b]), (sums[0][a:b], sums[1][a:b], sums[2][a:b]),
                energies[a:b],
            )  # fmt: skip
        came, goes = rows[5 + y % 2], rows[5 + (y + 1) % 2]
        _add_row(rows, came, force[y])
        if y + 1 < height:
            _pass_on(rows, goes)
    energy = 0.0
    for x in range(width):
        energy += energies[x]
    return energy


@kernel
def _anchor(
    targets: Row, position: Row, inside: NDArray[np.bool_], stiffness: NDArray[np.float32], sums: Sums,
    energies: NDArray[np.float64],
) -> None:  # fmt: skip
    """Springs of a row's pixels to their targets."""
    zero = np.float32(0)
    for x in range(len(inside)):
        ex, ey, k = targets[0][x] - position[0][x], targets[1][x] - position[1][x], stiffness[x]
        here = inside[x]
        sums[0][x] = k * ex if here else zero
        sums[1][x] = k * ey if here else zero
        sums[2][x] = k if here else zero
        energies[x] += np.float64(k * (ex * ex + ey * ey)) if here else 0.0


@kernel
def _stretch(
    here: Row, there: Row, inside: tuple[NDArray[np.bool_], NDArray[np.bool_]], rest: np.float32, forces: Sums,
    sums: Sums, energies: NDArray[np.float64],
) -> None:  # fmt: skip
    """Springs from the pixels of a row to others: their forces and stiffnesses, which are added to the sums, too."""
    zero = np.float32(0)
    for x in range(len(energies)):
        both = inside[0][x] & inside[1][x]
        ax, ay = there[0][x] - here[0][x], there[1][x] - here[1][x]
        length = np.sqrt(ax * ax + ay * ay)
        strain = length - rest
        pull = strain / max(length, np.float32(1e-6))
        fx, fy, one = pull * ax if both else zero, pull * ay if both else zero, np.float32(1) if both else zero
        forces[0][x], forces[1][x], forces[2][x] = fx, fy, one
        sums[0][x] += fx
        sums[1][x] += fy
        sums[2][x] += one
        energies[x] += np.float64(strain * strain) if both else 0.0


@kernel
def _add_row(rows: NDArray[np.float32], came: NDArray[np.float32], force: NDArray[np.float32]) -> None:
    """The forces on a row: of the springs from the row above, from the left, and of its own springs."""
    right, sums = rows[0], rows[4]
    for c in range(3):
        sign = np.float32(-1) if c < 2 else np.float32(1)
        for x in range(force.shape[0]):
            before = came[c, x]
            if x > 0:
                before += sign * right[c, x - 1]
            force[x, c] = before + sums[c, x]


@kernel
def _pass_on(rows: NDArray[np.float32], goes: NDArray[np.float32]) -> None:
    """The forces of a row's springs on the next row: from the left, from above, and from the right."""
    width = goes.shape[1]
    for c in range(3):
        sign = np.float32(-1) if c < 2 else np.float32(1)
        for x in range(width):
            total = np.float32(0)
            if x > 0:
                total += sign * rows[3, c, x - 1]
            total += sign * rows[2, c, x]
            if x + 1 < width:
                total += sign * rows[1, c, x + 1]
            goes[c, x] = total
