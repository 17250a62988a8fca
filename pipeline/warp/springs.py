"""Low-distortion warps by relaxation of a spring system on a grid (zhang2011patches, section 5).

Each pixel of a region is attached by a spring of rest length 0 to the target position given by its flow, and by springs
of rest lengths 1 and sqrt 2 to its eight neighbours. The relaxation moves the corners of a grid over the target by the
forces on the pixels around them, and pixels move with their cell. Several frames can be relaxed on one grid.

    E = sum k_p |x_p - t_p|^2  +  sum over neighbours (|x_p - x_q| - L0)^2
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.warp.spring_forces import Planes, strain

MOST_ITERATIONS = 10
STEP = 1.4
"""Step length of a corner, as a multiple of its force divided by the sum of the acting stiffnesses."""

_STIFFNESS = 2
"""Channel of the sum of stiffnesses in arrays of forces; channels 0 and 1 are the force along x and y."""

Positions = NDArray[np.float32]
"""float32 (h, w, 2): position (x, y) of each pixel of a rectangle in the target, px."""


@dataclass(frozen=True)
class Sheet:
    """Spring system of a region in one frame.

    Attributes:
        targets: float32 (h, w, 2), positions given by the flow: fixed ends of the springs, and initial positions.
        inside: bool (h, w), pixels of the rectangle that belong to the region.
        stiffness: float32 (h, w), stiffness k of the springs to the targets, >= 0.
        rest: rest length between 4-neighbours, px: the scale of the region's motion, so that uniform scaling is no
            distortion, times the stride of subsampled pixels.
    """

    targets: Positions
    inside: Mask
    stiffness: Plane
    rest: float = 1.0


@dataclass(frozen=True)
class Relaxed:
    """Result of a relaxation: displacements of the grid's corners, and the energies.

    Attributes:
        shifts: float32 (rows, columns, 2), displacement of each corner, px.
        origin: (x, y) of the first corner, px.
        cell: distance of the corners, px.
        before, after: energy E before and after, px^2; `after` <= `before`.
        iterations: number of steps.
    """

    shifts: NDArray[np.float32]
    origin: tuple[float, float]
    cell: float
    before: float
    after: float
    iterations: int

    def moved(self, positions: Positions) -> Positions:
        """Move positions, float32 (h, w, 2), with the grid."""
        corners, within = self.cells(positions)
        targets = _planes(positions)
        out = np.empty_like(targets)
        _lay(targets, corners, within, self.shifts.reshape(-1, 2), self.shifts.shape[1], out)
        return np.ascontiguousarray(np.moveaxis(out, 0, -1))

    def cells(self, positions: Positions) -> tuple[NDArray[np.int32], Positions]:
        """For each position, px: flat index of the first corner of its cell, and position (x, y) in that cell, 0..1."""
        corners, within = np.empty(positions.shape[:2], np.int32), np.empty_like(positions)
        _locate(positions, self.shifts.shape[:2], *self._place, corners, within)
        return corners, within

    @property
    def _place(self) -> tuple[np.float32, np.float32, np.float32]:
        return np.float32(self.origin[0]), np.float32(self.origin[1]), np.float32(1 / self.cell)


def relax(sheets: Sequence[Sheet], cell: float = 1.0, most: int = MOST_ITERATIONS) -> Relaxed:
    """Relax the sheets jointly, until the force no longer decreases or `most` steps are done.

    Args:
        cell: distance of the grid's corners, px.
        most: largest number of steps.

    Source: zhang2011patches, section 5. Departures: a corner's force is divided by the sum of the acting stiffnesses,
    since the paper's step (a quarter of the force) overshoots for k > 4 and its k is 10; the result is the step with
    the lowest energy, so the relaxation never increases the energy.
    """
    low, high = _bounds(sheets)
    origin = math.floor(low[0]) - cell, math.floor(low[1]) - cell
    columns, rows = (max(2, math.ceil((high[axis] - origin[axis]) / cell) + 2) for axis in (0, 1))
    shifts = np.zeros((rows, columns, 2), np.float32)
    grid = Relaxed(shifts, origin, cell, 0.0, 0.0, 0)
    laid = [_Laid.of(sheet, grid) for sheet in sheets]
    total = np.zeros((rows, columns, 3), np.float32)
    energy, force, moved = _pull(laid, shifts, total)
    before, best, kept, done = energy, energy, shifts, 0
    while done < most and force > 0:
        shifts = moved
        done += 1
        energy, now, moved = _pull(laid, shifts, total)
        if energy < best:
            best, kept = energy, shifts
        if now >= force:
            break
        force = now
    return Relaxed(kept, origin, cell, before, best, done)


@dataclass(frozen=True)
class _Laid:
    """A sheet on a grid, and its work arrays.

    Attributes:
        targets: float32 (2, h, w), the sheet's targets as planes of x and y.
        corners: int32 (h, w), flat index of the first corner of each pixel's cell.
        within: float32 (h, w, 2), position (x, y) in that cell, 0..1.
        positions: float32 (2, h, w), planes of the current x and y, px.
        force: float32 (h, w, 3), force on each pixel along x and y, and sum of its stiffnesses.
        rows, energies: see `strain`.
    """

    sheet: Sheet
    targets: Planes
    corners: NDArray[np.int32]
    within: Positions
    positions: Planes
    force: NDArray[np.float32]
    rows: NDArray[np.float32]
    energies: NDArray[np.float64]

    @classmethod
    def of(cls, sheet: Sheet, grid: Relaxed) -> _Laid:
        height, width = sheet.inside.shape
        corners, within = grid.cells(sheet.targets)
        targets, force = _planes(sheet.targets), np.empty((height, width, 3), np.float32)
        rows, energies = np.empty((7, 3, width), np.float32), np.empty(width)
        return cls(sheet, targets, corners, within, np.empty_like(targets), force, rows, energies)


def _planes(positions: Positions) -> Planes:
    return np.ascontiguousarray(np.moveaxis(positions, -1, 0), np.float32)


def _bounds(sheets: Sequence[Sheet]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Smallest and largest (x, y) of the targets; (0, 0) and (1, 1) if the sheets have no pixels."""
    ends = np.array([np.inf, np.inf, -np.inf, -np.inf], np.float32)
    for sheet in sheets:
        _bound(sheet.targets, sheet.inside, ends)
    return (ends[:2], ends[2:]) if ends[0] <= ends[2] else (np.zeros(2, np.float32), np.ones(2, np.float32))


def _pull(
    laid: Sequence[_Laid], shifts: NDArray[np.float32], total: NDArray[np.float32]
) -> tuple[float, float, NDArray[np.float32]]:
    """Energy, norm of the forces on the corners, and the shifts after a step, float32 (rows, columns, 2).

    Args:
        total: work array, float32 (rows, columns, 3), 0.
    """
    energy, columns = 0.0, shifts.shape[1]
    for one in laid:
        sheet = one.sheet
        _lay(one.targets, one.corners, one.within, shifts.reshape(-1, 2), columns, one.positions)
        energy += strain(
            one.positions, one.targets, sheet.inside, sheet.stiffness, np.float32(sheet.rest), one.force, one.rows,
            one.energies,
        )  # fmt: skip
        _gather(one.corners, one.within, sheet.inside, one.force, columns, total.reshape(-1, 3))
    moved = np.empty_like(shifts)
    force = _step(total, shifts, moved)
    return energy, math.sqrt(force), moved


def distortion(sheet: Sheet, positions: Positions) -> Plane:
    """Energy of each pixel at `positions`: its target spring and half of each neighbour spring, float32 (h, w)."""
    out = np.zeros(sheet.inside.shape, np.float32)
    _distortion(positions, sheet.targets, sheet.inside, sheet.stiffness, np.float32(sheet.rest), out)
    return out


@kernel
def _locate(
    targets: Positions, grid: tuple[int, int], ox: np.float32, oy: np.float32, per_cell: np.float32,
    corners: NDArray[np.int32], within: Positions,
) -> None:  # fmt: skip
    """Fill `corners` and `within`, see `Relaxed.cells`, on a grid of so many rows and columns."""
    rows, columns = grid
    for y in range(corners.shape[0]):
        for x in range(corners.shape[1]):
            u = (targets[y, x, 0] - ox) * per_cell
            v = (targets[y, x, 1] - oy) * per_cell
            u = min(max(u, np.float32(0.0)), np.float32(columns - 1.001))
            v = min(max(v, np.float32(0.0)), np.float32(rows - 1.001))
            i, j = int(v), int(u)
            corners[y, x] = i * columns + j
            within[y, x, 0], within[y, x, 1] = u - np.float32(j), v - np.float32(i)


@kernel
def _lay(
    targets: Planes, corners: NDArray[np.int32], within: Positions, shifts: NDArray[np.float32], columns: int,
    out: Planes,
) -> None:  # fmt: skip
    """Move each target by the bilinear mean of the shifts at the corners of its cell.

    Args:
        targets, out: float32 (2, h, w).
        shifts: float32 (rows * columns, 2).
    """
    for y in range(corners.shape[0]):
        for x in range(corners.shape[1]):
            first, a, b = corners[y, x], within[y, x, 0], within[y, x, 1]
            below = first + columns
            for c in range(2):
                top = shifts[first, c] + a * (shifts[first + 1, c] - shifts[first, c])
                low = shifts[below, c] + a * (shifts[below + 1, c] - shifts[below, c])
                out[c, y, x] = targets[c, y, x] + top + b * (low - top)


@kernel
def _bound(targets: Positions, inside: Mask, ends: NDArray[np.float32]) -> None:
    for y in range(inside.shape[0]):
        for x in range(inside.shape[1]):
            if inside[y, x]:
                for c in range(2):
                    ends[c] = min(ends[c], targets[y, x, c])
                    ends[2 + c] = max(ends[2 + c], targets[y, x, c])


@kernel
def _gather(
    corners: NDArray[np.int32], within: Positions, inside: Mask, force: NDArray[np.float32], columns: int,
    total: NDArray[np.float32],
) -> None:  # fmt: skip
    """Add each pixel's force and stiffness to the corners of its cell; `total` float32 (rows * columns, 3)."""
    one = np.float32(1.0)
    for y in range(inside.shape[0]):
        for x in range(inside.shape[1]):
            if not inside[y, x]:
                continue
            first, a, b = corners[y, x], within[y, x, 0], within[y, x, 1]
            below = first + columns
            for c in range(3):
                low, high = force[y, x, c] * (one - b), force[y, x, c] * b
                total[first, c] += low * (one - a)
                total[first + 1, c] += low * a
                total[below, c] += high * (one - a)
                total[below + 1, c] += high * a


@kernel
def _step(total: NDArray[np.float32], shifts: NDArray[np.float32], moved: NDArray[np.float32]) -> float:
    """Move each corner by `STEP` times its force divided by its stiffness; return the sum of squared forces.

    Args:
        total: force and stiffness of each corner, which are set to 0.
        moved: receives the new shifts.
    """
    result = 0.0
    for i in range(total.shape[0]):
        for j in range(total.shape[1]):
            fx, fy, stiff = total[i, j, 0], total[i, j, 1], total[i, j, _STIFFNESS]
            moved[i, j, 0], moved[i, j, 1] = shifts[i, j, 0], shifts[i, j, 1]
            if stiff > 0:
                moved[i, j, 0] += np.float32(STEP) * (fx / stiff)
                moved[i, j, 1] += np.float32(STEP) * (fy / stiff)
                result += fx * fx + fy * fy
            total[i, j, 0] = total[i, j, 1] = total[i, j, _STIFFNESS] = 0
    return result


@kernel
def _distortion(
    laid: Positions, targets: Positions, inside: Mask, stiffness: Plane, rest: np.float32, out: Plane
) -> None:
    height, width = inside.shape
    diagonal = rest * np.float32(1.4142135)
    for y in range(height):
        for x in range(width):
            if not inside[y, x]:
                continue
            ex, ey = targets[y, x, 0] - laid[y, x, 0], targets[y, x, 1] - laid[y, x, 1]
            total = stiffness[y, x] * (ex * ex + ey * ey)
            for n in range(9):
                dy, dx = n // 3 - 1, n % 3 - 1
                ny, nx = y + dy, x + dx
                if n == 4 or ny < 0 or nx < 0 or ny >= height or nx >= width or not inside[ny, nx]:
                    continue
                ax, ay = laid[ny, nx, 0] - laid[y, x, 0], laid[ny, nx, 1] - laid[y, x, 1]
                strain = np.sqrt(ax * ax + ay * ay) - (rest if dy == 0 or dx == 0 else diagonal)
                total += np.float32(0.5) * strain * strain
            out[y, x] = total
