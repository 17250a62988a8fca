"""Line responses of known curves."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.frames import Plane
from pipeline.lines.dog import dog_response
from pipeline.lines.linking import Curves, link_points
from pipeline.lines.ridges import Points, find_ridges

SIGMA_PX = 1.2
THRESHOLD, MARGIN = 1.0, 0.4


def stroked(curves: Sequence[Sequence[tuple[float, float]]], size: tuple[int, int], width_px: float = 2) -> Plane:
    """A light picture with dark polylines, drawn with sub-pixel precision: float32 (h, w)."""
    large = np.full((size[1] * 8, size[0] * 8), 200, np.uint8)
    for curve in curves:
        places = np.rint((np.array(curve) + 0.5) * 8).astype(np.int32)
        cv2.polylines(large, [places], False, 60, round(8 * width_px))
    return np.asarray(cv2.resize(large, size, interpolation=cv2.INTER_AREA), np.float32)


def traced(gray: Plane) -> tuple[Points, Curves, Plane]:
    """The points and curves of a picture, and its response."""
    response = dog_response(gray, SIGMA_PX, 0.99)
    points, index = find_ridges(response, np.full(gray.shape, 1 / 3, np.float32), THRESHOLD, MARGIN)
    return points, link_points(points, index), response


def lengths(curves: Curves) -> list[int]:
    """Number of points of each curve, longest first."""
    return sorted(np.diff(curves.starts).tolist(), reverse=True)
