"""Canny edges whose thresholds follow importance: zhang2011online, section 4.1."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane


def edges(
    gray: NDArray[np.uint8], importance: Plane, high: float, low_ratio: float = 0.4, floor: float = 0.2
) -> NDArray[np.uint8]:
    """Edge pixels (255) of `gray` (uint8 (h, w)), others 0.

    Args:
        importance: float32 at any size, 0..1; resized to the frame.
        high: upper hysteresis threshold where importance is 1 - floor: L1 norm of the 3x3 Sobel gradient, levels.
        low_ratio: lower threshold over upper, 0..1.
        floor: thresholds are `high / (importance + floor)`: inversely proportional, and finite at importance 0.

    A threshold that varies by pixel is a gradient that is scaled by pixel: the scaled gradient goes through
    OpenCV's Canny with one threshold.
    """
    size = (gray.shape[1], gray.shape[0])
    gain = cv2.resize(importance + np.float32(floor), size, interpolation=cv2.INTER_LINEAR)
    dx = cv2.Sobel(gray, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE)
    dy = cv2.Sobel(gray, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE)
    scaled = [cv2.multiply(d, gain, dtype=cv2.CV_16S) for d in (dx, dy)]
    return np.asarray(cv2.Canny(scaled[0], scaled[1], high * low_ratio, high), np.uint8)
