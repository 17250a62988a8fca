"""Difference-of-Gaussians lines (winnemoeller2006realtime, section 3.3), as used by zhang2011online."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel

GAUSSIAN_RATIO = 1.6
"""Ratio of the two standard deviations, as in the paper: Marr and Hildreth's approximation of the Laplacian."""
_TANH = np.rint(np.tanh(np.arange(1025) / 256) * 255).astype(np.uint8)
"""tanh of 0..4 in steps of 1/256, scaled so that 255 = 1."""


def dog_response(gray: Plane, sigma_px: float, tau: float) -> Plane:
    """D = tau * G(1.6 sigma) - G(sigma): float32 (h, w), gray levels, positive on the dark side of an edge."""
    narrow = _blur(gray, sigma_px)
    wide = _blur(gray, sigma_px * GAUSSIAN_RATIO)
    return np.asarray(cv2.addWeighted(wide, tau, narrow, -1.0, 0.0), np.float32)


def _blur(gray: Plane, sigma_px: float) -> Plane:
    """Gaussian blur, truncated at three standard deviations."""
    side = 2 * max(1, round(3 * sigma_px)) + 1
    return np.asarray(cv2.GaussianBlur(gray, (side, side), sigma_px), np.float32)


def soft_threshold(response: Plane, importance: Plane, threshold: float, sharpness: float) -> NDArray[np.uint8]:
    """Convert a response to ink, uint8 (h, w), 0..255: tanh(sharpness * (response - t)) above t, 0 below (eq. 6).

    Args:
        importance: float32 (h, w), 0..1.
        threshold: gray levels; t = threshold * (1.25 - 0.75 * importance), so more is drawn where importance is high.
        sharpness: 1/gray level.
    """
    out = np.empty(response.shape, np.uint8)
    _soft_threshold(response, importance, np.float32(threshold), np.float32(sharpness), _TANH, out)
    return out


@kernel
def _soft_threshold(
    response: Plane, importance: Plane, threshold: np.float32, sharpness: np.float32, table: NDArray[np.uint8],
    out: NDArray[np.uint8],
) -> None:  # fmt: skip
    height, width = response.shape
    steps = np.empty(width, np.int32)
    for y in range(height):
        for x in range(width):  # this vectorises
            least = threshold * (np.float32(1.25) - np.float32(0.75) * importance[y, x])
            over = (response[y, x] - least) * sharpness * np.float32(256.0)
            steps[x] = np.int32(min(max(over, np.float32(0)), np.float32(1024)))
        for x in range(width):
            out[y, x] = table[steps[x]]
