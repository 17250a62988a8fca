"""Contrast of faces. In a dim or hazy video, eyes, brows and mouth are hardly darker than the skin, and regions, lines
and strokes miss them. A face of low contrast gets the contrast of a well-lit one before it is analysed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.perception.face_masks import largeness
from pipeline.perception.faces import Faces


class FaceContrast(NamedTuple):
    """Constants of the contrast of faces."""

    least_contrast: float = 32.0
    """Standard deviation of the lightness in a face, gray levels, from which on the face stays as it is."""
    most_gain: float = 2.5
    """Largest factor on differences from the mean lightness."""
    half_width: float = 0.5
    half_height: float = 0.55
    """Semi-axes of the ellipse of a face without its hair, in sides of the detected box."""
    core: float = 0.7
    rim: float = 1.05
    """Distances from the middle, in semi-axes: the contrast is measured up to the first; the gain falls from there
    to 1 at the second, so that nothing around the face becomes lighter or darker."""
    large_rim: float = 0.9
    large_jaw: float = 0.25
    """`rim` of large faces, and by how much their ellipse is narrower at its lower end than in its middle. The wall
    beside the jaw of a large face would otherwise become a light crescent."""
    samples: int = 32
    """About the number of rows and columns in which the contrast is measured."""
    least_samples: int = 8
    """Number of measured pixels below which a face stays as it is."""


FACE_CONTRAST = FaceContrast()


def raise_contrast(picture: NDArray[np.uint8], faces: Faces, size: tuple[int, int]) -> None:
    """Raise the contrast of faces in which it is low, in place. Hues stay.

    Args:
        picture: uint8 (h, w, 1), lightness, or (h, w, 3), RGB.
        faces: of a frame.
        size: (width, height) of that frame, px.
    """
    scale = np.divide((picture.shape[1], picture.shape[0]), size)
    _raise(picture, faces["box"] * np.tile(scale, 2), faces["strength"].copy(), largeness(faces, size))


@kernel
def _raise(
    picture: NDArray[np.uint8], boxes: NDArray[np.float64], strengths: NDArray[np.float64], large: NDArray[np.float64]
) -> None:  # fmt: skip
    """`boxes`: (n, 4), centre x, centre y, width, height, px of the picture; `large`: (n,), see `largeness`."""
    height, width, channels = picture.shape
    one, most = np.float32(1), np.float32(255)
    for k in range(len(boxes)):
        half = boxes[k, 2] * FACE_CONTRAST.half_width, boxes[k, 3] * FACE_CONTRAST.half_height
        x0, y0 = boxes[k, 0] - 0.5, boxes[k, 1] - 0.5
        rim = FACE_CONTRAST.rim - large[k] * (FACE_CONTRAST.rim - FACE_CONTRAST.large_rim)
        columns = max(0, math.ceil(x0 - rim * half[0])), min(width, math.floor(x0 + rim * half[0]) + 1)
        rows = max(0, math.ceil(y0 - rim * half[1])), min(height, math.floor(y0 + rim * half[1]) + 1)
        mean, spread, count = _contrast(picture, rows, columns, (x0, y0), half)
        gain = np.float32((min(FACE_CONTRAST.least_contrast / spread, FACE_CONTRAST.most_gain) - 1) * strengths[k])
        if count < FACE_CONTRAST.least_samples or gain <= np.float32(0):
            continue
        for y in range(rows[0], rows[1]):
            dy = (y - y0) / half[1]
            across = half[0] * (1 - large[k] * FACE_CONTRAST.large_jaw * max(dy, 0.0))
            for x in range(columns[0], columns[1]):
                dx = (x - x0) / across
                far = dx * dx + dy * dy
                if far >= rim * rim:
                    continue
                ramp = np.float32(min((rim - np.sqrt(far)) / (rim - FACE_CONTRAST.core), 1.0))
                share = ramp * ramp * (np.float32(3) - np.float32(2) * ramp)
                light = _lightness(picture, y, x)
                factor = max(one + share * gain * (light - np.float32(mean)) / light, np.float32(0))
                for c in range(channels):
                    value = min(np.float32(picture[y, x, c]) * factor, most)
                    picture[y, x, c] = np.uint8(value + np.float32(0.5))


@kernel
def _contrast(
    picture: NDArray[np.uint8], rows: tuple[int, int], columns: tuple[int, int], centre: tuple[float, float],
    half: tuple[float, float],
) -> tuple[float, float, int]:  # fmt: skip
    """Mean and standard deviation (at least 1) of the lightness in the middle of a face, and the number of samples."""
    total, squares, count = 0.0, 0.0, 0
    for y in range(rows[0], rows[1], max(1, (rows[1] - rows[0]) // FACE_CONTRAST.samples)):
        dy = (y - centre[1]) / half[1]
        for x in range(columns[0], columns[1], max(1, (columns[1] - columns[0]) // FACE_CONTRAST.samples)):
            dx = (x - centre[0]) / half[0]
            if dx * dx + dy * dy < FACE_CONTRAST.core * FACE_CONTRAST.core:
                light = float(_lightness(picture, y, x))
                total += light
                squares += light * light
                count += 1
    mean = total / max(count, 1)
    return mean, math.sqrt(max(squares / max(count, 1) - mean * mean, 1.0)), count


@kernel
def _lightness(picture: NDArray[np.uint8], y: int, x: int) -> np.float32:
    """Lightness of a pixel, gray levels, at least 1."""
    if picture.shape[2] == 1:
        return np.float32(max(picture[y, x, 0], 1))
    red, green, blue = np.float32(picture[y, x, 0]), np.float32(picture[y, x, 1]), np.float32(picture[y, x, 2])
    return max(np.float32(0.299) * red + (np.float32(0.587) * green + np.float32(0.114) * blue), np.float32(1))
