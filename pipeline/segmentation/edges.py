"""Canny edges with thresholds that depend on importance (zhang2011online, section 4.1)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.jit import kernel


def edges(
    gray: NDArray[np.uint8], importance: Plane, high: float, low_ratio: float = 0.4, floor: float = 0.2
) -> NDArray[np.uint8]:
    """Canny edges: uint8 (h, w), 255 on edges, 0 elsewhere.

    Args:
        gray: uint8 (h, w), gray levels.
        importance: float32 at any size, 0..1; resized to the frame.
        high: upper hysteresis threshold where importance is 1 - floor: L1 norm of the 3x3 Sobel gradient, levels.
        low_ratio: ratio of the lower to the upper threshold, 0..1.
        floor: thresholds are `high / (importance + floor)`, which is finite at importance 0.

    A threshold that varies from pixel to pixel is equivalent to a scaled gradient, so the gradient is scaled and passed
    to OpenCV's Canny with a constant threshold.
    """
    size = (gray.shape[1], gray.shape[0])
    gain = np.asarray(cv2.resize(importance + np.float32(floor), size, interpolation=cv2.INTER_LINEAR), np.float32)
    gradient = cv2.spatialGradient(gray, ksize=3, borderType=cv2.BORDER_REPLICATE)
    dx, dy = (np.asarray(d, np.int16) for d in gradient)
    _scale(dx, dy, gain)
    return np.asarray(cv2.Canny(dx, dy, high * low_ratio, high), np.uint8)


@kernel
def _scale(dx: NDArray[np.int16], dy: NDArray[np.int16], gain: Plane) -> None:
    height, width = gain.shape
    for y in range(height):
        for x in range(width):
            dx[y, x] = np.int16(np.rint(dx[y, x] * gain[y, x]))
            dy[y, x] = np.int16(np.rint(dy[y, x] * gain[y, x]))
