"""Difference-of-Gaussians lines (winnemoeller2006realtime, section 3.3), as used by zhang2011online."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.frames import Plane

GAUSSIAN_RATIO = 1.6
"""Ratio of the two standard deviations, as in the paper: Marr and Hildreth's approximation of the Laplacian."""


def dog_response(gray: Plane, sigma_px: float, tau: float) -> Plane:
    """D = tau * G(1.6 sigma) - G(sigma): float32 (h, w), gray levels, positive on the dark side of an edge."""
    narrow = _blur(gray, sigma_px)
    wide = _blur(gray, sigma_px * GAUSSIAN_RATIO)
    return np.asarray(cv2.addWeighted(wide, tau, narrow, -1.0, 0.0), np.float32)


def _blur(gray: Plane, sigma_px: float) -> Plane:
    """Gaussian blur, truncated at three standard deviations."""
    side = 2 * max(1, round(3 * sigma_px)) + 1
    return np.asarray(cv2.GaussianBlur(gray, (side, side), sigma_px), np.float32)
