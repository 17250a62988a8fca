"""Static saliency by the spectral residual (hou2007spectral)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Plane


@dataclass(frozen=True)
class SaliencyParams:
    """Constants of saliency."""

    side_px: int = 64
    """Size at which saliency is computed, px, as in the paper."""
    average_px: int = 3
    blur_px: float = 2.5


SALIENCY = SaliencyParams()


def spectral_residual(gray: NDArray[np.uint8]) -> Plane:
    """Saliency map by the spectral residual: the deviation of the log spectrum from its local mean.

    Departure: the map is divided by its mean and mapped by 1 - exp(-x / 3) instead of being normalised to its maximum,
    so that a small bright spot that appears does not darken the rest of the map.

    Args:
        gray: uint8 (height, width), any size.

    Returns: float32 (64, 64) in [0, 1), covering the whole picture; 0 everywhere for a flat picture.
    """
    small = cv2.resize(gray, (SALIENCY.side_px, SALIENCY.side_px), interpolation=cv2.INTER_AREA).astype(np.float32)
    small -= small.mean()
    spectrum = cv2.dft(small, flags=cv2.DFT_COMPLEX_OUTPUT)
    amplitude = np.sqrt(_power(spectrum)) + np.float32(1e-3)
    log_amplitude = np.log(amplitude)
    residual = log_amplitude - cv2.blur(log_amplitude, (SALIENCY.average_px, SALIENCY.average_px))
    flattened = spectrum * (np.exp(residual) / amplitude)[..., None]
    signal = cv2.dft(flattened, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)
    energy = cv2.GaussianBlur(_power(signal), (0, 0), SALIENCY.blur_px)
    mean = float(energy.mean())
    if mean <= 1e-12 or float(np.ptp(small)) < 1.0:
        return np.zeros((SALIENCY.side_px, SALIENCY.side_px), np.float32)
    squeezed: Plane = (1 - np.exp(energy / np.float32(-3 * mean))).astype(np.float32, copy=False)
    return squeezed


def _power(spectrum: AnyArray) -> Plane:
    """Squared magnitude; `cv2.magnitude` is not used because its last bit depends on the alignment of its result."""
    real, imaginary = spectrum[..., 0], spectrum[..., 1]
    squared: Plane = real * real + imaginary * imaginary
    return squared
