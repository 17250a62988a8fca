"""Panoramas: the mean of many frames in common coordinates, and the mapping from frames to the panorama.

A placement maps a rectangle of a frame to the panorama: a homography plus a residual displacement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Plane
from pipeline.kernels.float16 import to_single
from pipeline.kernels.jit import kernel
from pipeline.warp.homography import Homography

Rect = tuple[int, int, int, int]
"""Left, top, right, bottom, px; right and bottom are exclusive."""


@dataclass(frozen=True)
class Placement:
    """Placement of a rectangle of a frame in the panorama: G(p) = matrix p + residual(p).

    Attributes:
        rect: the rectangle in the frame, working px.
        matrix: homography from frame to panorama coordinates, working px.
        residual: float16 or float32 (h, w, 2), residual displacement, working px.
    """

    rect: Rect
    matrix: Homography
    residual: AnyArray

    def positions(self) -> NDArray[np.float32]:
        """Panorama positions G of the rectangle's pixels: float32 (h, w, 2), working px."""
        out = np.empty((*self.residual.shape[:2], 2), np.float32)
        _place(np.array(self.matrix), self.rect[:2], to_single(self.residual), out)
        return out

    def at(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Panorama positions G of arbitrary points (h, w, 2) of the frame.

        The residual is interpolated bilinearly, and extended from the rectangle's border outside of it.
        """
        x = np.ascontiguousarray(points[..., 0] - np.float32(self.rect[0]))
        y = np.ascontiguousarray(points[..., 1] - np.float32(self.rect[1]))
        residual: AnyArray = cv2.remap(
            to_single(self.residual), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        out = np.empty(points.shape, np.float32)
        _map(np.array(self.matrix), points, residual, out)
        return out


@kernel
def _place(m: Homography, corner: tuple[int, int], residual: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Positions of the pixels of a rectangle with this top left corner, (x, y), by the homography plus the residual."""
    left, top = corner
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y = np.float64(left + j), np.float64(top + i)
            scale = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
            out[i, j, 0] = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale + residual[i, j, 0]
            out[i, j, 1] = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale + residual[i, j, 1]


@kernel
def _map(
    m: Homography, points: NDArray[np.float32], residual: NDArray[np.float32], out: NDArray[np.float32]
) -> None:  # fmt: skip
    """`_place` for the positions `points`."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y = np.float64(points[i, j, 0]), np.float64(points[i, j, 1])
            scale = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
            out[i, j, 0] = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale + residual[i, j, 0]
            out[i, j, 1] = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale + residual[i, j, 1]


class _FullSizeGrid(NamedTuple):
    """Relation of full-size pixels to working pixels, (x, y) each.

    Attributes:
        corner: top left of the rectangle, working px; first: of its pixels, px.
        ratio: width and height of a working pixel, px.
        origin: first pixel of the panorama, px.
    """

    corner: tuple[int, int]
    first: tuple[int, int]
    ratio: tuple[float, float]
    origin: tuple[int, int]


def full_map(placement: Placement, ratio: tuple[float, float], size: tuple[int, int], origin: tuple[int, int]) -> tuple[
    Rect, Plane, Plane
]:  # fmt: skip
    """Panorama positions of full-size pixels: a rectangle of the frame, px, and x and y, float32 (h, w) each, px.

    Args:
        ratio: width and height of a working pixel, px.
        size: (width, height) of the frame, px.
        origin: (x, y) of the panorama's first pixel, px.
    """
    left, top, right, bottom = placement.rect
    rect = (
        max(int(np.floor(left * ratio[0])), 0), max(int(np.floor(top * ratio[1])), 0),
        min(int(np.ceil(right * ratio[0])), size[0]), min(int(np.ceil(bottom * ratio[1])), size[1]),
    )  # fmt: skip
    shape = rect[3] - rect[1], rect[2] - rect[0]
    x, y = np.empty(shape, np.float32), np.empty(shape, np.float32)
    grid = _FullSizeGrid((left, top), (rect[0], rect[1]), ratio, origin)
    _full_map(to_single(placement.residual), np.array(placement.matrix), grid, x, y)
    return rect, x, y


@kernel
def _full_map(residual: NDArray[np.float32], m: Homography, grid: _FullSizeGrid, out_x: Plane, out_y: Plane) -> None:
    (left, top), (x0, y0), (rx, ry), (ox, oy) = grid
    rows, columns = residual.shape[:2]
    height, width = out_x.shape
    at, across, first = np.empty(width), np.empty(width, np.float32), np.empty(width, np.int64)
    for j in range(width):
        at[j] = (x0 + j + 0.5) / rx - 0.5
        u = min(max(at[j] - left, 0.0), columns - 1.0)
        first[j] = min(int(u), max(columns - 2, 0))
        across[j] = np.float32(u - first[j])
    # Rows of the residual, interpolated horizontally: row r is in place r % 2.
    wide, held = np.empty((2, 2, width), np.float32), np.full(2, -1)
    for i in range(height):
        y = (y0 + i + 0.5) / ry - 0.5
        v = min(max(y - top, 0.0), rows - 1.0)
        a = min(int(v), max(rows - 2, 0))
        b = np.float32(v - a)
        for r in range(a, min(a + 1, rows - 1) + 1):
            if held[r % 2] != r:
                held[r % 2] = r
                _widen(residual[r], first, across, wide[r % 2])
        below = min(a + 1, rows - 1) % 2
        _row(wide[a % 2, 0], wide[below, 0], b, (m[0], m[2]), at, y, (rx, float(ox)), out_x[i])
        _row(wide[a % 2, 1], wide[below, 1], b, (m[1], m[2]), at, y, (ry, float(oy)), out_y[i])


@kernel
def _widen(
    row: NDArray[np.float32], first: NDArray[np.int64], across: NDArray[np.float32], out: NDArray[np.float32]
) -> None:
    """A row of the residual, (columns, 2), at each full-size pixel: float32 (2, width)."""
    for j in range(len(first)):
        c, beside = first[j], min(first[j] + 1, len(row) - 1)
        out[0, j] = row[c, 0] + across[j] * (row[beside, 0] - row[c, 0])
        out[1, j] = row[c, 1] + across[j] * (row[beside, 1] - row[c, 1])


@kernel
def _row(
    upper: NDArray[np.float32], lower: NDArray[np.float32], b: np.float32,
    m: tuple[NDArray[np.float64], NDArray[np.float64]], at: NDArray[np.float64], y: float, to: tuple[float, float],
    out: NDArray[np.float32],
) -> None:  # fmt: skip
    """One coordinate of the positions of a row of pixels.

    Args:
        upper, lower, b: residual in two rows, and the distance from the first one, 0..1.
        m: rows of the homography: the coordinate's, and the last one.
        at, y: working px.
        to: size of a working pixel, px, and first pixel of the panorama, px.
    """
    ratio, origin = to
    p, q = m
    p0, p1, p2, q0, q1, q2 = p[0], p[1] * y, p[2], q[0], q[1] * y, q[2]
    for j in range(len(out)):
        scale = 1.0 / (q0 * at[j] + q1 + q2)
        position = (p0 * at[j] + p1 + p2) * scale + (upper[j] + b * (lower[j] - upper[j]))
        out[j] = np.float32((position + 0.5) * ratio - 0.5 - origin)


def gather(total: NDArray[np.float32], picture: Frame, weights: Plane, x: Plane, y: Plane) -> None:
    """Add a picture to a panorama, in place: each pixel is distributed bilinearly over four panorama pixels.

    Args:
        total: float32 (H, W, 4): sums of red, green, blue times weight, and of the weights.
        picture: uint8 (h, w, 3); weights: float32 (h, w), pixels of weight 0 do not count.
        x, y: float32 (h, w), positions in the panorama, px.
    """
    _gather(total, picture, weights, x, y)


@kernel
def _gather(total: NDArray[np.float32], picture: Frame, weights: Plane, x: Plane, y: Plane) -> None:
    height, width = total.shape[:2]
    for i in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            share = weights[i, j]
            u, v = x[i, j], y[i, j]
            if share <= 0 or not (u >= 0 and v >= 0 and u < width - 1 and v < height - 1):
                continue
            c, r = int(u), int(v)
            a, b = np.float64(u - np.float32(c)), np.float64(v - np.float32(r))
            red, green, blue = np.float32(picture[i, j, 0]), np.float32(picture[i, j, 1]), np.float32(picture[i, j, 2])
            _add_colour(total, r, c, share * (1.0 - b) * (1.0 - a), red, green, blue)
            _add_colour(total, r, c + 1, share * (1.0 - b) * a, red, green, blue)
            _add_colour(total, r + 1, c, share * b * (1.0 - a), red, green, blue)
            _add_colour(total, r + 1, c + 1, share * b * a, red, green, blue)


@kernel
def _add_colour(
    total: NDArray[np.float32], r: int, c: int, weight: float, red: np.float32, green: np.float32, blue: np.float32
) -> None:
    total[r, c, 0] += weight * red
    total[r, c, 1] += weight * green
    total[r, c, 2] += weight * blue
    total[r, c, 3] += weight


def mean(total: NDArray[np.float32], least: float = 0.05) -> tuple[Frame, Plane]:
    """Mean colours of the panorama, uint8 (H, W, 3), and its coverage, float32 (H, W), 0..1.

    Pixels with a weight below `least` are filled from their surroundings, since strokes may extend there.
    """
    weighted = np.empty(total.shape, np.float32)
    _weigh(total, np.float32(least), weighted)
    filled = _fill(weighted)
    return np.rint(np.clip(filled, 0, 255)).astype(np.uint8), weighted[..., 3].copy()


@kernel
def _weigh(total: NDArray[np.float32], least: np.float32, out: NDArray[np.float32]) -> None:
    """Mean colours times coverage, and the coverage."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            known = min(total[y, x, 3] / least, np.float32(1))
            weight = max(total[y, x, 3], np.float32(1e-6))
            for c in range(3):
                out[y, x, c] = total[y, x, c] / weight * known
            out[y, x, 3] = known


def _fill(weighted: NDArray[np.float32]) -> NDArray[np.float32]:
    """Push-pull interpolation: unknown pixels take the colour of the next coarser pyramid level."""
    height, width = weighted.shape[:2]
    known = weighted[..., 3:]
    if max(height, width) <= 1 or known.min() >= 1:
        return np.asarray(weighted[..., :3] / np.maximum(known, np.float32(1e-6)))
    small = np.asarray(
        cv2.resize(weighted, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA), np.float32
    )
    _grow(small)
    below = np.asarray(cv2.resize(_fill(small), (width, height), interpolation=cv2.INTER_LINEAR), np.float32)
    _lay_over(weighted, below)
    return below


@kernel
def _grow(small: NDArray[np.float32]) -> None:
    """Let a pixel of a coarser level that is known by a quarter or more count as known, in place."""
    for y in range(small.shape[0]):
        for x in range(small.shape[1]):
            share = max(small[y, x, 3], np.float32(1e-6))
            grown = min(small[y, x, 3] * np.float32(4), np.float32(1))
            for c in range(3):
                small[y, x, c] = small[y, x, c] / share * grown
            small[y, x, 3] = grown


@kernel
def _lay_over(weighted: NDArray[np.float32], below: NDArray[np.float32]) -> None:
    """Lay a level over the coarser one, in place."""
    for y in range(below.shape[0]):
        for x in range(below.shape[1]):
            unknown = np.float32(1) - weighted[y, x, 3]
            for c in range(3):
                below[y, x, c] = weighted[y, x, c] + below[y, x, c] * unknown
