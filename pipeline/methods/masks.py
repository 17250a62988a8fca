"""Masks that users paint or export: conversion to values from 0 to 1, and to the size of the frames."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Plane

_TINT = 16 / 255
"""Maximum difference of the channels of a gray picture: lossy formats tint gray slightly."""
_ASPECT_TOLERANCE = 0.02


def mask_plane(image: AnyArray) -> Plane:
    """A mask as float32 (h, w), 0..1.

    A gray mask has its gray values. In a mask in colours, as label maps with a palette are, every colour but black is
    1. Opacity is ignored.

    Args:
        image: uint8, uint16, or float32 0..1; gray, RGB or RGBA.
    """
    most = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1
    if image.ndim == 2:
        return np.asarray(image / most, np.float32)
    colours = image[..., :3]
    brightest = colours.max(axis=-1)
    if (brightest - colours.min(axis=-1)).max(initial=0) <= _TINT * most:
        return np.asarray(colours.mean(axis=-1) / most, np.float32)
    return np.asarray(brightest > _TINT * most, np.float32)


def drawn_plane(image: AnyArray) -> Plane:
    """`mask_plane`, and NaN where the image is transparent: nothing is drawn there."""
    plane = mask_plane(image)
    if image.ndim == 3 and image.shape[2] == 4:
        half = (np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1) / 2
        plane[image[..., 3] < half] = np.nan
    return plane


def fitted(plane: Plane, size: tuple[int, int], field: str) -> Plane:
    """A mask at the size (width, height) of the frames, float32 (h, w).

    Raises:
        BadParameter: it has another aspect ratio; `field` is the place.
    """
    height, width = plane.shape
    if (width, height) == size:
        return plane
    if abs(width * size[1] / (height * size[0]) - 1) > _ASPECT_TOLERANCE:
        raise BadParameter(
            "A mask must have the aspect ratio of the video.", field=field, value=f"{width}x{height}",
            remedy=f"Make it {size[0]}x{size[1]}, or of the same aspect ratio.",
        )  # fmt: skip
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32)
