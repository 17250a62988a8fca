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
from pipeline.jit import kernel
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
        _place(np.ascontiguousarray(self.matrix), self.rect[:2], self.residual.astype(np.float32), out)
        return out

    def at(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Panorama positions G of arbitrary points (h, w, 2) of the frame.

        The residual is interpolated bilinearly, and extended from the rectangle's border outside of it.
        """
        x = np.ascontiguousarray(points[..., 0] - np.float32(self.rect[0]))
        y = np.ascontiguousarray(points[..., 1] - np.float32(self.rect[1]))
        residual: AnyArray = cv2.remap(
            self.residual.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        out = np.empty(points.shape, np.float32)
        _map(np.ascontiguousarray(self.matrix), points, residual, out)
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
    _full_map(placement.residual.astype(np.float32), placement.matrix, grid, x, y)
    return rect, x, y


@kernel
def _full_map(residual: NDArray[np.float32], m: Homography, grid: _FullSizeGrid, out_x: Plane, out_y: Plane) -> None:
    (left, top), (x0, y0), (rx, ry), (ox, oy) = grid
    rows, columns = residual.shape[:2]
    for i in range(out_x.shape[0]):
        y = (y0 + i + 0.5) / ry - 0.5
        v = min(max(y - top, 0.0), rows - 1.0)
        a = min(int(v), max(rows - 2, 0))
        below = min(a + 1, rows - 1)
        b = np.float32(v - a)
        for j in range(out_x.shape[1]):
            x = (x0 + j + 0.5) / rx - 0.5
            u = min(max(x - left, 0.0), columns - 1.0)
            c = min(int(u), max(columns - 2, 0))
            beside = min(c + 1, columns - 1)
            d = np.float32(u - c)
            scale = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
            for k in range(2):
                upper = residual[a, c, k] + d * (residual[a, beside, k] - residual[a, c, k])
                lower = residual[below, c, k] + d * (residual[below, beside, k] - residual[below, c, k])
                off = upper + b * (lower - upper)
                position = (m[k, 0] * x + m[k, 1] * y + m[k, 2]) * scale + off
                if k == 0:
                    out_x[i, j] = np.float32((position + 0.5) * rx - 0.5 - ox)
                else:
                    out_y[i, j] = np.float32((position + 0.5) * ry - 0.5 - oy)


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
            a, b = u - np.float32(c), v - np.float32(r)
            for q in range(4):
                w = share * (b if q >= 2 else 1 - b) * (a if q % 2 else 1 - a)
                cell = total[r + q // 2, c + q % 2]
                cell[0] += w * picture[i, j, 0]
                cell[1] += w * picture[i, j, 1]
                cell[2] += w * picture[i, j, 2]
                cell[3] += w


def mean(total: NDArray[np.float32], least: float = 0.05) -> tuple[Frame, Plane]:
    """Mean colours of the panorama, uint8 (H, W, 3), and its coverage, float32 (H, W), 0..1.

    Pixels with a weight below `least` are filled from their surroundings, since strokes may extend there.
    """
    known = np.minimum(total[..., 3] / np.float32(least), 1)
    colours = total[..., :3] / np.maximum(total[..., 3:], np.float32(1e-6))
    filled = _fill(np.dstack([colours * known[..., None], known]).astype(np.float32))
    return np.rint(np.clip(filled, 0, 255)).astype(np.uint8), known.astype(np.float32)


def _fill(weighted: NDArray[np.float32]) -> NDArray[np.float32]:
    """Push-pull interpolation: unknown pixels take the colour of the next coarser pyramid level."""
    height, width = weighted.shape[:2]
    known = weighted[..., 3:]
    if max(height, width) <= 1 or known.min() >= 1:
        return np.asarray(weighted[..., :3] / np.maximum(known, np.float32(1e-6)))
    small = cv2.resize(weighted, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    share = np.maximum(small[..., 3:], np.float32(1e-6))
    grown = np.minimum(small[..., 3:] * 4, 1)
    small = np.dstack([small[..., :3] / share * grown, grown]).astype(np.float32)
    below = cv2.resize(_fill(np.asarray(small, np.float32)), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(weighted[..., :3] + below * (1 - known))
