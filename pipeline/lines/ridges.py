"""Ridges of a line response: the points at which it is largest across a line, with sub-pixel positions.

A quadratic surface is fitted to the 3x3 pixels around each pixel above the threshold. The pixel has a point where the
surface is largest along the direction in which it falls most steeply, if that place is within the pixel
(steger1998unbiased).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel

POINT = np.dtype([
    ("x", np.float32), ("y", np.float32), ("along_x", np.float32), ("along_y", np.float32), ("response", np.float32),
    ("threshold", np.float32), ("half_width", np.float32), ("importance", np.float32),
])  # fmt: skip
"""A point of a ridge: position, px (a pixel's centre has integer coordinates); unit vector along the ridge, of either
sign; response and its threshold, gray levels; distance across the ridge at which the response has fallen to
`WIDTH_SHARE`, px; importance, 0..1."""
Points: TypeAlias = NDArray[np.void]
"""Structured (`POINT`), in raster order."""

WIDTH_SHARE = 0.2
"""Share of the response on a ridge that outlines the line."""
_STEEPEST = np.float32(0.7)
"""Largest slope along a ridge, as a share of the response per px: the flank of another ridge is steeper."""
_HALF_PX = np.float32(0.5)


def find_ridges(
    response: Plane, importance: Plane, threshold: float, margin: float
) -> tuple[Points, NDArray[np.int32]]:
    """The points of the ridges of a response, and a plane with the index of each pixel's point, -1 = none.

    Args:
        response: float32 (h, w), gray levels, positive in lines.
        importance: float32 (h, w), 0..1.
        threshold: least response, gray levels; it is scaled by 1.25 - 0.75 * importance.
        margin: gray levels by which a point exceeds the threshold.
    """
    index = np.full(response.shape, -1, np.int32)
    points = np.empty(response.size // 2, POINT)
    count = _find(response, importance, np.float32(threshold), np.float32(margin), points, index)
    return points[:count].copy(), index


@kernel
def _find(
    response: Plane, importance: Plane, threshold: np.float32, margin: np.float32, points: Points,
    index: NDArray[np.int32],
) -> int:  # fmt: skip
    height, width = response.shape
    count = 0
    for y in range(1, height - 1):
        above, row, below = response[y - 1], response[y], response[y + 1]
        for x in range(1, width - 1):
            if row[x] <= margin:
                continue
            least = threshold * (np.float32(1.25) - np.float32(0.75) * importance[y, x])
            if row[x] <= least + margin or count == points.size:
                continue
            left, middle = above[x - 1] + row[x - 1] + below[x - 1], above[x] + row[x] + below[x]
            right = above[x + 1] + row[x + 1] + below[x + 1]
            top, centre = above[x - 1] + above[x] + above[x + 1], row[x - 1] + row[x] + row[x + 1]
            bottom = below[x - 1] + below[x] + below[x + 1]
            slope_x, slope_y = (right - left) / np.float32(6), (bottom - top) / np.float32(6)
            xx, yy = (left - 2 * middle + right) / np.float32(3), (top - 2 * centre + bottom) / np.float32(3)
            xy = (above[x - 1] - above[x + 1] - below[x - 1] + below[x + 1]) / np.float32(4)
            half, mean = (xx - yy) * np.float32(0.5), (xx + yy) * np.float32(0.5)
            root = np.sqrt(half * half + xy * xy)
            curvature = mean - root
            if curvature >= 0:
                continue
            # The eigenvector of the smaller eigenvalue, from the row of the matrix that is further from 0.
            across_x, across_y = (xy, -(half + root)) if half > 0 else (half - root, xy)
            length = np.sqrt(across_x * across_x + across_y * across_y)
            if length == 0:
                continue
            across_x, across_y = across_x / length, across_y / length
            move = -(slope_x * across_x + slope_y * across_y) / curvature
            dx, dy = move * across_x, move * across_y
            if abs(dx) > _HALF_PX or abs(dy) > _HALF_PX:
                continue
            if abs(slope_x * across_y - slope_y * across_x) > _STEEPEST * row[x]:
                continue
            point = points[count]
            point["x"], point["y"] = x + dx, y + dy
            point["along_x"], point["along_y"] = -across_y, across_x
            point["response"], point["threshold"] = row[x], least
            point["half_width"] = np.sqrt(np.float32(2 * (1 - WIDTH_SHARE)) * row[x] / -curvature)
            point["importance"] = importance[y, x]
            index[y, x] = count
            count += 1
    return count
