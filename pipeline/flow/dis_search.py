"""Search for displaced patches, and the dense flow that follows from them: the first two parts of a scale of DIS.

Source: kroeger2016dis, sections 2.1 to 2.4. The numbers are those of OpenCV's implementation, bit by bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.flow.gray import Gray
from pipeline.flow.patch_sums import PATCH_PX, Four, Pixels, patch_sums
from pipeline.frames import Plane
from pipeline.jit import kernel_without_overlap

BORDER_PX = 2 * PATCH_PX
"""Border of the second picture in which patches may lie, px."""
PASSES = 2
"""Passes over the patches: forwards, then backwards."""
STRIPES = 8
"""Stripes of rows of patches; displacements spread within each."""
_LEAST_DETERMINANT = 0.001
"""Least determinant of a patch's structure tensor: a flat patch has none."""
_INSIDE = 0.001
"""Distance, px, that a pixel keeps from the last row or column, where its neighbour is needed."""
_SHARE = 1 / (PATCH_PX * PATCH_PX)
"""Share of a pixel in the mean of its patch."""


@kernel_without_overlap
def sum_gradients(
    dx: NDArray[np.int16], dy: NDArray[np.int16], stride_px: int, rows: NDArray[np.float32], sums: NDArray[np.float32]
) -> None:
    """Sums of dx^2, dy^2, dx dy, dx and dy over each patch.

    Args:
        dx, dy: int16 (h, w), gradient of the first picture.
        stride_px: distance of patches, px.
        rows: float32 (5, h, columns), for sums over eight pixels of a row.
        sums: float32 (5, lines, columns), receives the result.
    """
    height, width = dx.shape
    columns, zero = sums.shape[2], np.float32(0)
    for y in range(height):
        xx, yy, xy, x_sum, y_sum, column = zero, zero, zero, zero, zero, 0
        for x in range(width):
            a, b = np.int32(dx[y, x]), np.int32(dy[y, x])
            old_a, old_b = np.int32(0), np.int32(0)
            if x >= PATCH_PX:
                old_a, old_b = np.int32(dx[y, x - PATCH_PX]), np.int32(dy[y, x - PATCH_PX])
            xx += np.float32(np.int32(a * a - old_a * old_a))
            yy += np.float32(np.int32(b * b - old_b * old_b))
            xy += np.float32(np.int32(a * b - old_a * old_b))
            x_sum += np.float32(np.int32(a - old_a))
            y_sum += np.float32(np.int32(b - old_b))
            if x + 1 == PATCH_PX + column * stride_px and column < columns:
                rows[0, y, column], rows[1, y, column], rows[2, y, column] = xx, yy, xy
                rows[3, y, column], rows[4, y, column] = x_sum, y_sum
                column += 1
    for kind in range(5):
        total, line = np.zeros(columns, np.float32), 0
        for y in range(height):
            if y < PATCH_PX:
                for column in range(columns):
                    total[column] += rows[kind, y, column]
            else:
                for column in range(columns):
                    total[column] += rows[kind, y, column] - rows[kind, y - PATCH_PX, column]
            if y + 1 == PATCH_PX + line * stride_px and line < sums.shape[1]:
                sums[kind, line] = total
                line += 1


@kernel_without_overlap
def search_patches(
    pictures: tuple[Pixels, Pixels, Pixels, Pixels], size: tuple[int, int], stride_px: int, steps: int,
    flow: tuple[Plane, Plane], sums: NDArray[np.float32], found: tuple[Plane, Plane],
) -> None:  # fmt: skip
    """Displacement of each patch: the best one of those of its neighbours, improved by gradient descent.

    Args:
        pictures: the first picture, dx and dy, float32 (h * w,), and the second picture with a border of b =
            `BORDER_PX`, float32 ((h + 2 b) * (w + 2 b),).
        size: (h, w).
        stride_px: distance of patches, px.
        steps: maximum of steps of descent for a patch in each of two passes.
        flow: (x, y), float32 (h, w), px, of the coarser scale.
        sums: float32 (5, lines, columns), from `sum_gradients`.
        found: (x, y), float32 (lines, columns), px, receive the result.
    """
    lines, columns = found[0].shape
    deep = -(-lines // STRIPES)
    for stripe in range(STRIPES):
        top, end = min(stripe * deep, lines), min((stripe + 1) * deep, lines)
        for line in range(top, end):
            above = line - 1 if line > top else -1
            for column in range(columns):
                y, x = line * stride_px + PATCH_PX // 2, column * stride_px + PATCH_PX // 2
                found[0][line, column], found[1][line, column] = flow[0][y, x], flow[1][y, x]
                _improve(pictures, size, stride_px, steps, sums, found, (line, column), (above, column - 1))
        for line in range(end - 1, top - 1, -1):
            below = line + 1 if line < end - 1 else -1
            for column in range(columns - 1, -1, -1):
                right = column + 1 if column < columns - 1 else -1
                _improve(pictures, size, stride_px, steps, sums, found, (line, column), (below, right))


@kernel_without_overlap
def _improve(
    pictures: tuple[Pixels, Pixels, Pixels, Pixels], size: tuple[int, int], stride_px: int, steps: int,
    sums: NDArray[np.float32], found: tuple[Plane, Plane], patch: tuple[int, int], neighbours: tuple[int, int],
) -> None:  # fmt: skip
    """One patch in one pass.

    Args:
        patch: its line and column.
        neighbours: line of the neighbour in its column, and column of the neighbour in its line; -1 = none.
    """
    line, column = patch
    width, wide = size[1], size[1] + 2 * BORDER_PX
    y, x = line * stride_px, column * stride_px
    at, share = y * width + x, np.float32(_SHARE)
    u, v = found[0][line, column], found[1][line, column]
    place, weights = _placed(y, x, u, v, size)
    by_x, by_y, d, dd = patch_sums(pictures, at, width, place, wide, weights)
    error = dd - d * d * share
    for k in range(2):
        if k == 0 and neighbours[1] >= 0:
            other_u, other_v = found[0][line, neighbours[1]], found[1][line, neighbours[1]]
        elif k == 1 and neighbours[0] >= 0:
            other_u, other_v = found[0][neighbours[0], column], found[1][neighbours[0], column]
        else:
            continue
        place, weights = _placed(y, x, other_u, other_v, size)
        other_x, other_y, other_d, dd = patch_sums(pictures, at, width, place, wide, weights)
        other_error = dd - other_d * other_d * share
        if other_error < error:
            error, u, v, by_x, by_y, d = other_error, other_u, other_v, other_x, other_y, other_d

    xx, yy, xy = sums[0, line, column], sums[1, line, column], sums[2, line, column]
    x_sum, y_sum = sums[3, line, column], sums[4, line, column]
    determinant = xx * yy - xy * xy
    if abs(determinant) < np.float32(_LEAST_DETERMINANT):
        determinant = np.float32(_LEAST_DETERMINANT)
    a, b, c = yy / determinant, -xy / determinant, xx / determinant
    start_u, start_v, before = u, v, np.float32(np.inf)
    for step in range(steps):
        if step > 0:
            place, weights = _placed(y, x, u, v, size)
            by_x, by_y, d, dd = patch_sums(pictures, at, width, place, wide, weights)
            error = dd - d * d * share
        by_x, by_y = by_x - d * x_sum * share, by_y - d * y_sum * share
        u -= a * by_x + b * by_y
        v -= b * by_x + c * by_y
        if error >= before:
            break
        before = error
    far_u, far_v = np.float64(u - start_u), np.float64(v - start_v)
    near = np.sqrt(far_u * far_u + far_v * far_v) <= PATCH_PX
    found[0][line, column], found[1][line, column] = (u, v) if near else (start_u, start_v)


@kernel_without_overlap
def _placed(y: int, x: int, u: np.float32, v: np.float32, size: tuple[int, int]) -> tuple[int, Four]:
    """Index, in the second picture with its border, of the patch at (x, y) displaced by (u, v), rounded down; weights
    for interpolation."""
    one, border, least = np.float32(1), np.float32(BORDER_PX), np.float32(BORDER_PX - PATCH_PX + 1)
    down = min(max(np.float32(y) + v + border, least), np.float32(BORDER_PX + size[0] - 1))
    across = min(max(np.float32(x) + u + border, least), np.float32(BORDER_PX + size[1] - 1))
    top, left = np.floor(down), np.floor(across)
    lower, right = down - top, across - left
    upper, nearer = top + one - down, left + one - across
    place = int(down) * (size[1] + 2 * BORDER_PX) + int(across)
    return place, (upper * nearer, upper * right, lower * nearer, lower * right)


@kernel_without_overlap
def make_dense(
    first: Gray, second: Gray, size: tuple[int, int], found: tuple[Plane, Plane], stride_px: int, total: Pixels,
    flow: tuple[Pixels, Pixels],
) -> None:  # fmt: skip
    """Flow of each pixel: the mean of the displacements of the patches that cover it, weighted by how well each fits.

    Args:
        first, second: uint8 (h * w,).
        size: (h, w).
        found: (x, y), float32 (lines, columns), displacements, px.
        stride_px: distance of patches, px. The last ones of a line or column also cover what is left beyond them.
        total: float32 (h * w,), for sums of weights.
        flow: (x, y), float32 (h * w,), px, receive the result.
    """
    (height, width), (lines, columns) = size, found[0].shape
    one, zero = np.float32(1), np.float32(0)
    last_x, last_y = np.float32(width) - one - np.float32(_INSIDE), np.float32(height) - one - np.float32(_INSIDE)
    places = np.empty(2 * PATCH_PX, np.int32)
    right, left = np.empty(2 * PATCH_PX, np.float32), np.empty(2 * PATCH_PX, np.float32)
    total[:], flow[0][:], flow[1][:] = zero, zero, zero
    for line in range(lines):
        top = line * stride_px
        bottom = height if line == lines - 1 else top + PATCH_PX
        for column in range(columns):
            u, v, start = found[0][line, column], found[1][line, column], column * stride_px
            count = width - start if column == columns - 1 else PATCH_PX
            together = 0  # columns that lie beside each other in the second picture as well
            for k in range(count):
                to_x = min(max(np.float32(np.int32(start + k)) + u, zero), last_x)
                places[k] = np.int32(to_x)
                right[k] = to_x - np.float32(places[k])
                left[k] = np.float32(places[k] + np.int32(1)) - to_x
                together += places[k] - places[0] == k
            for y in range(top, bottom):
                to_y = min(max(np.float32(y) + v, zero), last_y)
                row = int(to_y)
                down = to_y - np.float32(row), np.float32(row + 1) - to_y
                done = 0
                if together == count:
                    here = y * width + start, row * width + places[0], width
                    _add_eight(first, second, here, (right, left), down, (u, v), total, flow)
                    done = PATCH_PX
                for k in range(done, count):
                    at, there = y * width + start + k, row * width + places[k]
                    corners = second[there], second[there + 1], second[there + width], second[there + width + 1]
                    weight = _weight(first[at], corners, (right[k], left[k]), down)
                    flow[0][at] += weight * u
                    flow[1][at] += weight * v
                    total[at] += weight
    for at in range(height * width):
        flow[0][at] /= total[at]
        flow[1][at] /= total[at]


@kernel_without_overlap
def _add_eight(
    first: Gray, second: Gray, here: tuple[int, int, int], across: tuple[Pixels, Pixels],
    down: tuple[np.float32, np.float32], displacement: tuple[np.float32, np.float32], total: Pixels,
    flow: tuple[Pixels, Pixels],
) -> None:  # fmt: skip
    """Add eight pixels of a row of a patch. `here`: index of the first one in both pictures, and their width, px."""
    at, there, width = np.uint64(here[0]), np.uint64(here[1]), np.uint64(here[2])
    for k in range(np.uint64(PATCH_PX)):  # this vectorises
        corner = there + k
        below, one = corner + width, np.uint64(1)
        corners = second[corner], second[corner + one], second[below], second[below + one]
        weight = _weight(first[at + k], corners, (across[0][k], across[1][k]), down)
        flow[0][at + k] += weight * displacement[0]
        flow[1][at + k] += weight * displacement[1]
        total[at + k] += weight


@kernel_without_overlap
def _weight(
    here: int, corners: tuple[int, int, int, int], across: tuple[np.float32, np.float32],
    down: tuple[np.float32, np.float32],
) -> np.float32:  # fmt: skip
    """Weight of a displacement for a pixel: 1 over the difference that it leaves, in gray levels, at most 1.

    Args:
        here: gray level of the pixel.
        corners: those of the four pixels around the place that it is displaced to, row by row.
        across, down: distances of that place from the first column and from the second one; from the rows.
    """
    (right, left), (lower, upper) = across, down
    d = right * lower * np.float32(corners[3]) + left * lower * np.float32(corners[2])
    d = d + right * upper * np.float32(corners[1]) + left * upper * np.float32(corners[0]) - np.float32(here)
    return np.float32(1) / max(np.float32(1), abs(d))
