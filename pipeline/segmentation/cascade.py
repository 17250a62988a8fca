"""Viola and Jones's detector (viola2001rapid): a cascade of classifiers, tested in windows of a picture.

The cascades are OpenCV's files, and the accepted windows are those of its `CascadeClassifier`, in a third of its time.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.gray import Gray
from pipeline.intrinsics import LANES
from pipeline.segmentation.cascade_windows import integrate, search
from pipeline.segmentation.stump_votes import RECTS, Stumps

DENSE_FROM = 2.0
"""Side of a window, in sides of the smallest one, from which every position is tested; below it, every second one in
every second row."""
_TOLERANCE = np.float32(1e-5)
"""Subtracted from the thresholds of stages."""
_STRIDES_PX = 64
"""Rows of integral images are multiples of this long, so that the corners of features are seldom computed anew."""
_CORNERS_KEPT = 16
"""Number of tables of corners, for different rows and steps, that a cascade keeps."""
_STRIPE_PX = 32
"""Columns of windows for each stripe of rows into which OpenCV divides a search."""

Window = tuple[int, int, int, int]
"""Left, top, width and height, px."""


class Cascade:
    """A cascade of stages. A stage is a sum of votes of weak classifiers, and a window that gets too few is rejected.

    Args:
        path: XML file of OpenCV, whose weak classifiers are stumps with upright Haar features.

    Raises: OSError, ValueError, IndexError.

    Attributes:
        side: side of the smallest window, px.
        stumps: the weak classifiers of all stages.
        stages: int32 (n + 1,), the first stump of each stage, and their number; float32 (n,), votes that it needs.
        corners: corners of all rectangles for a stride and a step, see `_corners`; the last few are kept.
    """

    def __init__(self, path: Path) -> None:
        classifiers, _, features = path.read_text().partition("<features>")
        self.side = int(_numbers(classifiers, "width")[0])
        nodes = _numbers(classifiers, "internalNodes").reshape(-1, 4)
        feature, threshold = nodes[:, 2].astype(int), nodes[:, 3].astype(np.float32)
        rects = _rects(features)[feature]
        self._rects = rects[..., :4].astype(np.int32)
        votes = _numbers(classifiers, "leafValues").astype(np.float32)
        self.stumps: Stumps = (rects[..., 4].astype(np.float32).reshape(-1), threshold, votes)
        needed = _numbers(classifiers, "stageThreshold").astype(np.float32) - _TOLERANCE
        counts = _numbers(classifiers, "maxWeakCount")[-len(needed) :]  # the first one is the largest of all
        self.stages = np.append(0, np.cumsum(counts)).astype(np.int32), needed
        self.corners = lru_cache(_CORNERS_KEPT)(self._corners)

    def _corners(self, stride: int, step: int) -> NDArray[np.int32]:
        """Corners of each stump's rectangles, as `add_votes` takes them: int32 (stumps * 12,).

        Args:
            stride: numbers in a row of the integral image.
            step: distance of windows, 1 or 2 px.
        """
        x, y, width, height = np.moveaxis(self._rects, -1, 0)
        left, right = _place(x, stride, step), _place(x + width, stride, step)
        top, bottom = y * stride, (y + height) * stride
        corners = np.stack([top + left, top + right, bottom + left, bottom + right], axis=-1)
        return corners.astype(np.int32).reshape(-1)


def _numbers(text: str, tag: str) -> NDArray[np.float64]:
    """The numbers in all elements of this name."""
    return np.array(" ".join(re.findall(f"<{tag}>([^<]*)<", text)).split(), np.float64)


def _rects(text: str) -> NDArray[np.float64]:
    """Rectangles of all features, float64 (n, 3, 5): left, top, width, height and weight; 0 where there are only two.
    The first one of a feature, and no other one, has the weight -1."""
    rects = _numbers(text, "_").reshape(-1, 5)
    firsts = np.flatnonzero(rects[:, 4] == -1)
    counts = np.diff(firsts, append=len(rects))
    found = np.zeros((len(firsts), RECTS, 5))
    found[np.repeat(np.arange(len(firsts)), counts), np.arange(len(rects)) - np.repeat(firsts, counts)] = rects
    return found


def _place(x: NDArray[np.int32], stride: int, step: int) -> NDArray[np.int32]:
    """Places of columns in a row of the integral image: see `integrate`."""
    return x if step == 1 else x % 2 * (stride // 2) + x // 2


def accepted_windows(cascade: Cascade, gray: Gray, ratio: float, least_px: int, most_px: int) -> list[Window]:
    """The windows of a picture that a cascade accepts.

    Args:
        gray: uint8 (h, w).
        ratio: ratio of consecutive sides of windows, above 1.
        least_px, most_px: least and largest side; if no side is between them, the nearest to `least_px` is taken.
    """
    height, width = gray.shape
    found: list[Window] = []
    stripes = 0
    for scale in _scales(cascade.side, ratio, range(least_px, most_px + 1), min(width, height)):
        size = round(float(np.float32(width) / scale)), round(float(np.float32(height) / scale))
        picture = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_LINEAR_EXACT), np.uint8)
        step = 1 if scale >= DENSE_FROM else 2
        across, rows = size[0] + 1 - cascade.side, size[1] + 1 - cascade.side
        # OpenCV divides the rows between threads, and thereby misses the last one at times.
        stripes = stripes or math.ceil(across / _STRIPE_PX)
        rows = min(rows, max((rows // step + stripes - 1) // stripes, 1) * step * stripes)
        side = _scaled(cascade.side, scale)
        for x, y in _accepted(cascade, picture, (across, rows), step).tolist():
            left, top = _scaled(x, scale), _scaled(y, scale)
            found.append((left, top, min(side, width - left), min(side, height - top)))
    return found


def _scales(side_px: int, ratio: float, sides_px: range, largest_px: int) -> list[np.float32]:
    """Sides of windows, in sides of the smallest one: those in a range; if there is none, the one nearest to its
    start."""
    every, scale = [], 1.0
    while round(side_px * scale) <= largest_px:
        every.append(np.float32(scale))
        scale *= ratio
    fitting = [scale for scale in every if _scaled(side_px, scale) in sides_px]
    return fitting or sorted(every, key=lambda scale: abs(_scaled(side_px, scale) - sides_px.start))[:1]


def _scaled(length: int, scale: np.float32) -> int:
    return round(float(np.float32(length) * scale))


def _accepted(cascade: Cascade, picture: Gray, area: tuple[int, int], step: int) -> NDArray[np.int32]:
    """Corners (x, y) of the smallest windows that the cascade accepts, int32 (n, 2), px.

    Args:
        area: numbers of columns and of rows in which they may be.
        step: distance of windows, px.
    """
    height, width = picture.shape
    stride = math.ceil((width + 1 + 2 * LANES) / _STRIDES_PX) * _STRIDES_PX
    sums = np.empty((2, (height + 1) * stride + LANES), np.int32)
    integrate(picture, stride, step, sums)
    windows = math.ceil(area[0] / step)
    row = np.zeros(windows + LANES, np.float32), np.zeros(windows + LANES, np.uint8), np.empty(LANES, np.float64)
    found = np.empty((windows * math.ceil(area[1] / step), 2), np.int32)
    corners = cascade.corners(stride, step)
    count = search((*sums, stride), (*area, step, cascade.side), (corners, cascade.stumps, *cascade.stages), row, found)
    return found[:count]
