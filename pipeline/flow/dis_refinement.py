"""Variational refinement of a dense flow: the last part of a scale of DIS.

The refined flow minimises differences of brightness and of gradients between the pictures, and differences between the
flows of neighbours. Each outer iteration linearises the robust penalties and solves the linear system by successive
over-relaxation (SOR). The numbers are those of OpenCV's implementation, bit by bit.

Planes are split into the two colours of a chequerboard: red are the pixels whose row and column have an even sum. All
four neighbours of a pixel have the other colour, and those of a row of red pixels are rows of black ones, which the
compiler can vectorise.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.gray import Gray
from pipeline.frames import Plane
from pipeline.jit import kernel_without_overlap

SOR_STEPS = 5
"""Steps of relaxation in an outer iteration."""
OMEGA = np.float32(1.6)
"""Factor of over-relaxation."""
SMOOTHNESS, BRIGHTNESS, GRADIENT = np.float32(20 / 2), np.float32(5 / 2), np.float32(10 / 2)
"""Halves of the weights of the three terms."""
_ZETA_SQUARED = np.float32(0.1) * np.float32(0.1)
_EPSILON_SQUARED = np.float32(0.01) * np.float32(0.01)

Cells = NDArray[np.float32]
"""One colour of a plane, float32 (n,): rows of half of the width, rounded up, one after another, each with a cell
before and behind, and a row above and below. Those, and the last cell of a row that is shorter, are 0."""
Planes = NDArray[np.float32]
"""Several planes in one colour: float32 (planes, n)."""


def refine(first: Gray, second: Gray, flow_x: Plane, flow_y: Plane, iterations: int) -> None:
    """Refine a flow in place.

    Args:
        first, second: uint8 (h, w).
        flow_x, flow_y: float32 (h, w), px, from the first picture to the second.
        iterations: outer iterations.
    """
    _solve(_derivatives(first, second, flow_x, flow_y), flow_x, flow_y, iterations)


def _derivatives(first: Gray, second: Gray, flow_x: Plane, flow_y: Plane) -> NDArray[np.float32]:
    """Derivatives that the terms of the data need: Ix, Iy, Iz, Ixx, Ixy, Iyy, Ixz, Iyz, float32 (8, h, w). I is the
    mean of the first picture and the second one, warped by the flow; z is the change from one to the other."""
    height, width = first.shape
    across, down = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)[:, None]
    warped = cv2.remap(
        second.astype(np.float32), across + flow_x, down + flow_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    mean = cv2.addWeighted(first, 0.5, warped, 0.5, 0, dtype=cv2.CV_32F)
    made = np.empty((8, height, width), np.float32)
    x, y, z, xx, xy, yy, xz, yz = made
    cv2.subtract(warped, first, dst=z, dtype=cv2.CV_32F)
    for plane, across_it, down_it in ((mean, x, y), (x, xx, xy), (y, None, yy), (z, xz, yz)):
        if across_it is not None:
            cv2.Sobel(plane, -1, 1, 0, across_it, ksize=1, borderType=cv2.BORDER_REPLICATE)
        cv2.Sobel(plane, -1, 0, 1, down_it, ksize=1, borderType=cv2.BORDER_REPLICATE)
    return made


@kernel_without_overlap
def _solve(derivatives: NDArray[np.float32], flow_x: Plane, flow_y: Plane, iterations: int) -> None:
    """Refine the flow in place, with the derivatives from `_derivatives`."""
    height, width = flow_x.shape
    across = (width + 1) // 2 + 2
    cells = (height + 2) * across
    slopes, system = np.zeros((2, 8, cells), np.float32), np.zeros((2, 5, cells), np.float32)
    start, step = np.zeros((2, 2, cells), np.float32), np.zeros((2, 2, cells), np.float32)
    weights, grid = np.zeros((2, cells), np.float32), (across, width)
    for k in range(8):
        _split(derivatives[k], across, slopes[0, k], slopes[1, k])
    _split(flow_x, across, start[0, 0], start[1, 0])
    _split(flow_y, across, start[0, 1], start[1, 1])
    now = start.copy()
    for _ in range(iterations):
        for colour in range(2):
            _weigh(now[colour], now[1 - colour], grid, colour, weights[colour])
        for colour in range(2):
            other, out = 1 - colour, system[colour]
            both_weights, both_starts = (weights[colour], weights[other]), (start[colour], start[other])
            into = out[0], out[1], out[2], out[3], out[4]
            _linearise(slopes[colour], step[colour], both_weights, both_starts, grid, colour, into)
        _relax(system, weights, grid, (step[0, 0], step[0, 1]), (step[1, 0], step[1, 1]))
        _add(start.reshape(-1), step.reshape(-1), now.reshape(-1))
    _merge(now[0, 0], now[1, 0], across, flow_x)
    _merge(now[0, 1], now[1, 1], across, flow_y)


@kernel_without_overlap
def _add(one: Cells, other: Cells, out: Cells) -> None:
    for k in range(out.size):
        out[k] = one[k] + other[k]


@kernel_without_overlap
def _split(plane: Plane, across: int, red: Cells, black: Cells) -> None:
    """Copy a plane into the cells of both colours. `across`: cells from one row to the next."""
    height, width = plane.shape
    for y in range(height):
        row, start = plane[y], (y + 1) * across + 1
        even, odd = (red[start:], black[start:]) if y % 2 == 0 else (black[start:], red[start:])
        for k in range(width // 2):  # this vectorises
            even[k], odd[k] = row[2 * k], row[2 * k + 1]
        if width % 2:
            even[width // 2] = row[width - 1]


@kernel_without_overlap
def _merge(red: Cells, black: Cells, across: int, plane: Plane) -> None:
    """Copy the cells of both colours into a plane."""
    height, width = plane.shape
    for y in range(height):
        row, start = plane[y], (y + 1) * across + 1
        even, odd = (red[start:], black[start:]) if y % 2 == 0 else (black[start:], red[start:])
        for k in range(width // 2):  # this vectorises
            row[2 * k], row[2 * k + 1] = even[k], odd[k]
        if width % 2:
            row[width - 1] = even[width // 2]


@kernel_without_overlap
def _weigh(here: Planes, other: Planes, grid: tuple[int, int], colour: int, weights: Cells) -> None:
    """Weights of the term of smoothness for the pixels of one colour.

    Args:
        here, other: the flow (x, y) in this colour and in the other one, px.
        grid: cells from one row to the next; width of the plane, px.
        colour: 0 = red, 1 = black.
        weights: receive the result.
    """
    across, width = grid
    rows = weights.size // across - 2
    for y in range(rows):
        odd = (y + colour) % 2
        start, count = np.uint64((y + 1) * across + 1), (width + 1 - odd) // 2
        last_column = (width - odd) // 2
        for k in range(np.uint64(count)):  # this vectorises
            at = start + k
            right, below = at + np.uint64(odd), at + np.uint64(across)
            has_right, has_below = np.float32(k < last_column), np.float32(y < rows - 1)
            ux, vx = (other[0, right] - here[0, at]) * has_right, (other[1, right] - here[1, at]) * has_right
            uy, vy = (other[0, below] - here[0, at]) * has_below, (other[1, below] - here[1, at]) * has_below
            weights[at] = SMOOTHNESS / np.sqrt(ux * ux + vx * vx + uy * uy + vy * vy + _EPSILON_SQUARED)


@kernel_without_overlap
def _linearise(
    slopes: Planes, step: Planes, both_weights: tuple[Cells, Cells], both_starts: tuple[Planes, Planes],
    grid: tuple[int, int], colour: int, into: tuple[Cells, Cells, Cells, Cells, Cells],
) -> None:  # fmt: skip
    """Coefficients, for the pixels of one colour, of the linear system that `_relax` solves.

    Args:
        slopes: derivatives, see `_derivatives`.
        step: the solution (x, y) so far, px, by which the flow differs from the one at the start.
        both_weights: from `_weigh`, of this colour and of the other one.
        both_starts: the flow (x, y) at the start, px, in this colour and in the other one.
        grid: cells from one row to the next; width of the plane, px.
        colour: 0 = red, 1 = black.
        into: receive a11, a12, a22, b1 and b2.
    """
    (weights, other_weights), (start, other_start), (across, width) = both_weights, both_starts, grid
    a11, a12, a22, b1, b2 = into
    rows = weights.size // across - 2
    for y in range(rows):
        odd = (y + colour) % 2
        first, count = np.uint64((y + 1) * across + 1), (width + 1 - odd) // 2
        last_column = (width - odd) // 2
        for k in range(np.uint64(count)):  # this vectorises
            at = first + k
            ix, iy, iz, du, dv = slopes[0, at], slopes[1, at], slopes[2, at], step[0, at], step[1, at]
            norm = ix * ix + iy * iy + _ZETA_SQUARED
            change = iz + ix * du + iy * dv
            weight = BRIGHTNESS / np.sqrt(change * change / norm + _EPSILON_SQUARED) / norm
            p11, p12, p22 = weight * (ix * ix) + _ZETA_SQUARED, weight * (ix * iy), weight * (iy * iy) + _ZETA_SQUARED
            q1, q2 = -(weight * (iz * ix)), -(weight * (iz * iy))

            xx, xy, yy, xz, yz = slopes[3, at], slopes[4, at], slopes[5, at], slopes[6, at], slopes[7, at]
            norm_x, norm_y = xx * xx + xy * xy + _ZETA_SQUARED, yy * yy + xy * xy + _ZETA_SQUARED
            change_x, change_y = xz + xx * du + xy * dv, yz + xy * du + yy * dv
            weight = GRADIENT / np.sqrt(change_x * change_x / norm_x + change_y * change_y / norm_y + _EPSILON_SQUARED)
            p11 += weight * (xx * xx / norm_x + xy * xy / norm_y)
            a12[at] = p12 + weight * (xx * xy / norm_x + xy * yy / norm_y)
            p22 += weight * (xy * xy / norm_x + yy * yy / norm_y)
            q1 -= weight * (xx * xz / norm_x + xy * yz / norm_y)
            q2 -= weight * (xy * xz / norm_x + yy * yz / norm_y)

            right, above, below = at + np.uint64(odd), at - np.uint64(across), at + np.uint64(across)
            left = right - np.uint64(1)
            wl, wa = other_weights[left], other_weights[above]
            wr = weights[at] * np.float32(k < last_column)
            wb = weights[at] * np.float32(y < rows - 1)
            u, v = start[0, at], start[1, at]
            right_u, right_v = wr * (other_start[0, right] - u), wr * (other_start[1, right] - v)
            left_u, left_v = wl * (u - other_start[0, left]), wl * (v - other_start[1, left])
            below_u, below_v = wb * (other_start[0, below] - u), wb * (other_start[1, below] - v)
            above_u, above_v = wa * (u - other_start[0, above]), wa * (v - other_start[1, above])
            if colour == 0:  # OpenCV's order of additions depends on the colour
                a11[at], a22[at] = p11 + wr + wl + wb + wa, p22 + wr + wl + wb + wa
                b1[at], b2[at] = q1 + right_u - left_u + below_u - above_u, q2 + right_v - left_v + below_v - above_v
            else:
                a11[at], a22[at] = p11 + wl + wr + wa + wb, p22 + wl + wr + wa + wb
                b1[at], b2[at] = q1 - left_u + right_u - above_u + below_u, q2 - left_v + right_v - above_v + below_v


@kernel_without_overlap
def _relax(
    system: NDArray[np.float32], weights: Planes, grid: tuple[int, int], red: tuple[Cells, Cells],
    black: tuple[Cells, Cells],
) -> None:  # fmt: skip
    """`SOR_STEPS` steps of relaxation, in place of the solution (x, y) in both colours, px.

    All half-steps, red and black in turn, proceed over the rows at the same time, each a row behind the one before, so
    that the rows stay in the cache. This changes no number: a row needs the rows around it of the half-step before.

    Args:
        system: float32 (2, 5, n), a11, a12, a22, b1 and b2 of red cells and of black ones.
        weights: from `_weigh`, red and black.
        grid: cells from one row to the next; width of the plane, px.
    """
    across, width = grid
    rows = weights.shape[1] // across - 2
    for front in range(rows + 2 * SOR_STEPS - 1):
        for half in range(max(0, front - rows + 1), min(2 * SOR_STEPS, front + 1)):
            y = front - half
            odd = (y + half) % 2
            place = (y + 1) * across + 1, across, odd, (width + 1 - odd) // 2
            if half % 2 == 0:
                _relax_row(place, system[0], weights[0], weights[1], black, red)
            else:
                _relax_row(place, system[1], weights[1], weights[0], red, black)


@kernel_without_overlap
def _relax_row(
    place: tuple[int, int, int, int], system: Planes, weights: Cells, other_weights: Cells,
    other: tuple[Cells, Cells], here: tuple[Cells, Cells],
) -> None:  # fmt: skip
    """A row of a half-step. `place`: its first cell, cells to the next row, 1 if its columns are odd, its cells."""
    (x, y), (other_x, other_y) = here, other
    first, step, shift, count = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2]), np.uint64(place[3])
    for k in range(count):  # this vectorises
        at = first + k
        right, above, below = at + shift, at - step, at + step
        left = right - np.uint64(1)
        w, wl, wa = weights[at], other_weights[left], other_weights[above]
        sum_x = wl * other_x[left] + w * other_x[right] + wa * other_x[above] + w * other_x[below]
        sum_y = wl * other_y[left] + w * other_y[right] + wa * other_y[above] + w * other_y[below]
        a11, a12, a22, b1, b2 = system[0, at], system[1, at], system[2, at], system[3, at], system[4, at]
        u = x[at] + OMEGA * ((sum_x + b1 - y[at] * a12) / a11 - x[at])
        v = y[at] + OMEGA * ((sum_y + b2 - u * a12) / a22 - y[at])
        x[at], y[at] = u, v
