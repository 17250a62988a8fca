"""Canny edges of colours, with thresholds that depend on importance (zhang2011online, section 4.1)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.perception.face_masks import FaceCrop

Gradient = NDArray[np.int16]
"""int16 (h, w): a component of the 3x3 Sobel gradient of a plane, levels."""
CHROMA_SCALE = np.float32(2.2)
"""Weight of a level of a* and b* relative to one of L*, which has 255 levels for 100 units; a little less than 2.55,
because videos store chroma at half of the resolution, with more noise."""


def edges(
    lab: NDArray[np.uint8], importance: Plane, high: float, faces: Sequence[FaceCrop] = (), low_ratio: float = 0.4,
    floor: float = 0.2,
) -> NDArray[np.uint8]:  # fmt: skip
    """Canny edges: uint8 (h, w), 255 on edges, 0 elsewhere.

    Args:
        lab: uint8 (3, h, w), planes L, a, b of 8-bit CIELAB.
        importance: float32 at any size, 0..1; resized to the frame.
        high: upper hysteresis threshold where importance is 1 - floor: L1 norm of the 3x3 Sobel gradient, levels of L.
        faces: small faces in the frame; inside them the chroma does not count, whose edges lie beside those of eyes
            and lips.
        low_ratio: ratio of the lower to the upper threshold, 0..1.
        floor: thresholds are `high / (importance + floor)`, which is finite at importance 0.

    A threshold that varies from pixel to pixel is equivalent to a scaled gradient, so the gradient is scaled and passed
    to OpenCV's Canny with a constant threshold.

    Departure: the gradient of a pixel has the direction of the plane that changes most, and the length of all three. In
    the lightness alone, a green letter on a white toy has no edge.
    """
    size = (lab.shape[2], lab.shape[1])
    gain = np.asarray(cv2.resize(importance + np.float32(floor), size, interpolation=cv2.INTER_LINEAR), np.float32)
    light, a, b = (_gradient(plane) for plane in lab)
    for face in faces:
        for part in (*a, *b):
            part[face.box] = np.rint(part[face.box] * (1 - face.weight))
    _combine(light, a, b, gain)
    return np.asarray(cv2.Canny(*light, high * low_ratio, high), np.uint8)


def _gradient(plane: NDArray[np.uint8]) -> tuple[Gradient, Gradient]:
    dx, dy = cv2.spatialGradient(plane, ksize=3, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(dx, np.int16), np.asarray(dy, np.int16)


@kernel
def _combine(
    light: tuple[Gradient, Gradient], a: tuple[Gradient, Gradient], b: tuple[Gradient, Gradient], gain: Plane
) -> None:  # fmt: skip
    """Replace the gradient of L, `light`, by that of L, a and b, times `gain`."""
    height, width = gain.shape
    (dx, dy), (ax, ay), (bx, by) = light, a, b
    for y in range(height):
        for x in range(width):  # this vectorises
            gx, gy = np.float32(dx[y, x]), np.float32(dy[y, x])
            px, py = CHROMA_SCALE * np.float32(ax[y, x]), CHROMA_SCALE * np.float32(ay[y, x])
            qx, qy = CHROMA_SCALE * np.float32(bx[y, x]), CHROMA_SCALE * np.float32(by[y, x])
            of_l, of_a, of_b = gx * gx + gy * gy, px * px + py * py, qx * qx + qy * qy
            gx, gy = (px, py) if of_a > of_l else (gx, gy)
            gx, gy = (qx, qy) if of_b > max(of_l, of_a) else (gx, gy)
            scale = gain[y, x] * np.sqrt((of_l + of_a + of_b) / max(max(of_l, of_a), max(of_b, np.float32(1))))
            dx[y, x] = np.int16(np.rint(gx * scale))
            dy[y, x] = np.int16(np.rint(gy * scale))
