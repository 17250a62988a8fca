"""Smaller pictures for cues that need no details."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def size_within(size: tuple[int, int], side: int) -> tuple[int, int]:
    """(width, height) of a picture with the longer side `side`, px; `size` itself if that is smaller."""
    scale = min(1.0, side / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def shrink(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Picture of (width, height) `size`: repeatedly halved by area averaging, then bilinear; OpenCV's area averaging by
    other factors is ten times slower."""
    while image.shape[1] >= 2 * size[0] and image.shape[0] >= 2 * size[1]:
        half = (image.shape[1] // 2, image.shape[0] // 2)
        even = image[: 2 * half[1], : 2 * half[0]]
        image = np.asarray(cv2.resize(even, half, interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
