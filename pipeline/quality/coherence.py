"""Measures temporal coherence, detail, and legibility of the subject of a painted video."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Mask, Plane, same_size
from pipeline.perception.flow.dis import dis
from pipeline.perception.flow.gray import to_gray
from pipeline.perception.flow.reliability import motion_boundary, visible
from pipeline.perception.flow.warp import warp_back

STRUCTURE_WIDTH_PX = 160
_LEAST_ERROR = 1e-12
"""Guards quotients where the source is static or blank."""


@dataclass(frozen=True)
class PairMeasure:
    """One pair of consecutive frames of the source and of the painted video.

    Errors are sums of squared differences over visible pixels, three channels in 0..1, between a frame and its
    predecessor warped to it; `visible_px` is the number of those pixels.
    """

    painted_error: float
    source_error: float
    visible_px: int

    @property
    def flicker(self) -> float:
        """Square root of the painted video's warping error over that of the source: 1 = as steady as the source; lower
        values are steadier."""
        return flicker(self.painted_error, self.source_error)


def flicker(painted_error: float, source_error: float) -> float:
    """sqrt(painted_error / source_error), for errors of the same pixels."""
    return float(np.sqrt(painted_error / max(source_error, _LEAST_ERROR)))


def measure_pair(source: tuple[Frame, Frame], painted: tuple[Frame, Frame]) -> PairMeasure:
    """Warping error of two consecutive frames (lai2018learning, eq. 9 and 10).

    The dense flow is that of the source (DIS, medium). Only pixels are compared that are visible in both frames and
    do not lie on a motion boundary.

    Args:
        source: frames t - 1 and t, uint8 (height, width, 3).
        painted: the same frames of the painted video, same size.

    Raises: BadFrame (sizes differ).
    """
    differences, compared = _warped_differences(source, painted)
    return _measure(differences, compared)


def flicker_map(source: tuple[Frame, Frame], painted: tuple[Frame, Frame]) -> tuple[PairMeasure, Plane]:
    """The measure of `measure_pair`, and a map of the flicker. A frame is compared with the one before it, warped by
    the source's flow; the map is the painting's difference minus that of the source.

    Returns:
        The measure, and float32 (height, width), 0..1: root mean square over the channels of the painting's warped
        difference, less that of the source, at least 0; 0 where pixels are not compared.

    Raises: BadFrame (sizes differ).
    """
    differences, compared = _warped_differences(source, painted)
    painted_rms, source_rms = (
        np.sqrt(np.square(each.astype(np.float32) / 255).mean(axis=-1, dtype=np.float32)) for each in differences
    )
    excess = np.where(compared, np.maximum(painted_rms - source_rms, 0), 0)
    return _measure(differences, compared), np.asarray(excess, np.float32)


def _warped_differences(
    source: tuple[Frame, Frame], painted: tuple[Frame, Frame]
) -> tuple[tuple[AnyArray, AnyArray], Mask]:
    """Absolute differences of the painting and of the source from their warped predecessors, uint8 (height, width, 3),
    and the pixels that can be compared."""
    size = (source[0].shape[1], source[0].shape[0])
    for frame in (source[1], *painted):
        same_size(frame, size)
    before, now = (to_gray(frame) for frame in source)
    back = dis(now, before, "medium")
    compared = visible(back, dis(before, now, "medium")) & ~motion_boundary(back)
    painted_difference, source_difference = (
        cv2.absdiff(warp_back(pair[0], back), pair[1]) for pair in (painted, source)
    )
    return (painted_difference, source_difference), compared


def _measure(differences: tuple[AnyArray, AnyArray], compared: Mask) -> PairMeasure:
    painted_error, source_error = (
        float(np.square(each[compared].astype(np.float64) / 255).sum()) for each in differences
    )
    return PairMeasure(painted_error, source_error, int(compared.sum()))


def detail(frame: Frame) -> float:
    """Mean magnitude of the lightness gradient (3x3 Sobel), gray levels; to be compared with that of the source."""
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return float(cv2.magnitude(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1)).mean())


def structure(source: Frame, painted: Frame) -> float:
    """Correlation (Pearson) of the coarse edges of two frames at a width of 160 px, -1..1; 0 where one has no edges.

    Near 1 the scene reads as in the source; near 0 the subject is lost.
    """
    edges = [_coarse_edges(frame) for frame in (source, painted)]
    if min(float(plane.std()) for plane in edges) < _LEAST_ERROR:
        return 0.0
    return float(np.corrcoef(edges[0].ravel(), edges[1].ravel())[0, 1])


def _coarse_edges(frame: Frame) -> NDArray[np.float32]:
    """Gradient magnitude, summed over the channels of CIE Lab, of the blurred frame at a width of 160 px."""
    height = max(2, round(STRUCTURE_WIDTH_PX * frame.shape[0] / frame.shape[1]))
    small = cv2.resize(frame, (STRUCTURE_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    lab = cv2.GaussianBlur(cv2.cvtColor(small, cv2.COLOR_RGB2Lab).astype(np.float32), (0, 0), 1)
    gradient = np.hypot(cv2.Sobel(lab, cv2.CV_32F, 1, 0), cv2.Sobel(lab, cv2.CV_32F, 0, 1))
    return np.asarray(gradient.sum(axis=-1), dtype=np.float32)
