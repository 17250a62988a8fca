"""The smoothed structure tensor and its tangent field.

Directions have no sign and cannot be averaged as vectors, since opposite sides of a line would cancel. Tensors can be
averaged. Smoothing over space or time is therefore done on the tensor, and the tangent is computed last.
"""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.jit import kernel

Tensors: TypeAlias = NDArray[np.float32]
"""A symmetric 2 x 2 tensor per pixel, `float32` (3, height, width): the planes xx, xy, yy."""

FLAT = 0.01
"""Difference of the eigenvalues, (gray levels/px)^2, up to which the direction is undefined: 0.1 gray levels/px."""


def structure_tensor(gray: Plane, sigma_px: float) -> Tensors:
    """Gaussian-blurred outer product of the gray gradient with itself: float32 (3, h, w), (gray levels/px)^2.

    Args:
        gray: float32 (h, w), gray levels.
        sigma_px: sigma of the Gaussian, > 0; structures closer than this share a direction.

    The gradient is Scharr's, the 3 x 3 operator with the least bias in direction; border pixels are replicated.
    """
    dx = cv2.Scharr(gray, cv2.CV_32F, 1, 0, scale=1 / 32, borderType=cv2.BORDER_REPLICATE)
    dy = cv2.Scharr(gray, cv2.CV_32F, 0, 1, scale=1 / 32, borderType=cv2.BORDER_REPLICATE)
    out = np.empty((3, *gray.shape), np.float32)
    for plane, (a, b) in zip(out, ((dx, dx), (dx, dy), (dy, dy)), strict=True):
        np.multiply(a, b, out=plane)
        cv2.GaussianBlur(plane, (0, 0), sigma_px, dst=plane)
    return out


def tangent_field(tensors: Tensors, flat: float = FLAT) -> Flow:
    """Unit vector along the structure (minor eigenvector), float32 (h, w, 2): (x, y); (0, 0) where undefined.

    The sign is arbitrary: t and -t are the same direction, and neighbours may differ in sign.

    Args:
        tensors: float32 (3, h, w), smoothed.
        flat: largest difference of the eigenvalues at which the direction is undefined, (gray levels/px)^2, >= 0.

    Source: the edge tangent flow of kang2007coherent, section 2.1.

    Departure: the paper filters vectors iteratively, weighted by similarity; here tensors are smoothed once, linearly.
    Half-angle formulas are used: square roots and divisions round alike on every processor, arc tangents do not.
    """
    out = np.empty((*tensors.shape[1:], 2), np.float32)
    _tangents(tensors, np.float32(flat), out)
    return out


@kernel
def _tangents(tensors: Tensors, flat: np.float32, out: Flow) -> None:
    half, one = np.float32(0.5), np.float32(1.0)
    _, height, width = tensors.shape
    for y in range(height):
        for x in range(width):
            u, v = tensors[0, y, x] - tensors[2, y, x], tensors[1, y, x] + tensors[1, y, x]
            length = np.sqrt(u * u + v * v)
            known = length > flat
            scale = half / (length if known else one)
            larger = np.sqrt((length + abs(u)) * scale) if known else one
            smaller = v * scale / larger
            steep = u < 0.0
            tx = larger if steep else smaller
            ty = -smaller if steep else -larger
            out[y, x, 0] = tx if known else 0.0
            out[y, x, 1] = ty if known else 0.0
