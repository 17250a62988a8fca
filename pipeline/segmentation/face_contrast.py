"""Contrast of faces. In a dim or hazy video, eyes, brows and mouth are hardly darker than the skin, and regions, lines
and strokes miss them. A face of low contrast gets the contrast of a well-lit one before it is analysed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.jit import kernel
from pipeline.segmentation.faces import Faces

LEAST_CONTRAST = 32.0
"""Standard deviation of the lightness in a face, gray levels, from which on the face stays as it is."""
MOST_GAIN = 2.5
"""Largest factor on differences from the mean lightness."""
HALF_WIDTH, HALF_HEIGHT = 0.5, 0.55
"""Semi-axes of the ellipse of a face without its hair, in sides of the detected box."""
CORE, RIM = 0.7, 1.05
"""Distances from the middle, in semi-axes: the contrast is measured up to the first; the gain falls from there to 1 at
the second, so that nothing around the face becomes lighter or darker."""
SAMPLES = 32
"""About the number of rows and columns in which the contrast is measured."""
LEAST_SAMPLES = 8
"""Number of measured pixels below which a face stays as it is."""


def raise_contrast(picture: NDArray[np.uint8], faces: Faces, size: tuple[int, int]) -> None:
    """Raise the contrast of faces in which it is low, in place. Hues stay.

    Args:
        picture: uint8 (h, w, 1), lightness, or (h, w, 3), RGB.
        faces: of a frame.
        size: (width, height) of that frame, px.
    """
    height, width = picture.shape[:2]
    across, down = width / size[0], height / size[1]
    for face in faces:
        cx, cy, wide, high = face["box"] * (across, down, across, down)
        half = wide * HALF_WIDTH, high * HALF_HEIGHT
        left, right = max(0, math.floor(cx - RIM * half[0])), min(width, math.ceil(cx + RIM * half[0]))
        top, bottom = max(0, math.floor(cy - RIM * half[1])), min(height, math.ceil(cy + RIM * half[1]))
        if left < right and top < bottom:
            _raise(picture[top:bottom, left:right], (cx - left - 0.5, cy - top - 0.5), half, float(face["strength"]))


@kernel
def _raise(part: NDArray[np.uint8], centre: tuple[float, float], half: tuple[float, float], strength: float) -> None:
    """`centre`, `half`: x and y, px of `part`."""
    height, width, channels = part.shape
    mean, spread, count = _contrast(part, centre, half)
    gain = np.float32((min(LEAST_CONTRAST / spread, MOST_GAIN) - 1) * strength)
    if count < LEAST_SAMPLES or gain <= np.float32(0):
        return
    one, most = np.float32(1), np.float32(255)
    for y in range(height):
        dy = (y - centre[1]) / half[1]
        for x in range(width):
            dx = (x - centre[0]) / half[0]
            far = dx * dx + dy * dy
            if far >= RIM * RIM:
                continue
            ramp = np.float32(min((RIM - np.sqrt(far)) / (RIM - CORE), 1.0))
            share = ramp * ramp * (np.float32(3) - np.float32(2) * ramp)
            light = _lightness(part, y, x)
            factor = max(one + share * gain * (light - np.float32(mean)) / light, np.float32(0))
            for c in range(channels):
                part[y, x, c] = np.uint8(min(np.float32(part[y, x, c]) * factor, most) + np.float32(0.5))


@kernel
def _contrast(
    part: NDArray[np.uint8], centre: tuple[float, float], half: tuple[float, float]
) -> tuple[float, float, int]:
    """Mean and standard deviation (at least 1) of the lightness in the middle of a face, and the number of samples."""
    height, width = part.shape[:2]
    total, squares, count = 0.0, 0.0, 0
    for y in range(0, height, max(1, height // SAMPLES)):
        dy = (y - centre[1]) / half[1]
        for x in range(0, width, max(1, width // SAMPLES)):
            dx = (x - centre[0]) / half[0]
            if dx * dx + dy * dy < CORE * CORE:
                light = float(_lightness(part, y, x))
                total += light
                squares += light * light
                count += 1
    mean = total / max(count, 1)
    return mean, math.sqrt(max(squares / max(count, 1) - mean * mean, 1.0)), count


@kernel
def _lightness(part: NDArray[np.uint8], y: int, x: int) -> np.float32:
    """Lightness of a pixel, gray levels, at least 1."""
    if part.shape[2] == 1:
        return np.float32(max(part[y, x, 0], 1))
    red, green, blue = np.float32(part[y, x, 0]), np.float32(part[y, x, 1]), np.float32(part[y, x, 2])
    return max(np.float32(0.299) * red + (np.float32(0.587) * green + np.float32(0.114) * blue), np.float32(1))
