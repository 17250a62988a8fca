"""Conversion of pictures between uint8, uint16 and float32, sRGB-encoded and linear, with and without opacity.

A picture is an array (h, w, 3) RGB or (h, w, 4) RGBA with straight opacity. White is 255, 65535 or 1.0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadFrame

FULL: dict[np.dtype[Any], int] = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}
"""Value of white in each integer type."""
DTYPES = (*FULL, np.dtype(np.float32))
"""Types of pictures that encoders accept."""


def white_of(picture: AnyArray) -> int:
    """Value of white in the picture's type."""
    return FULL.get(picture.dtype, 1)


def as_uint8(picture: AnyArray) -> NDArray[np.uint8]:
    """The picture with 8 bits a channel, rounded to nearest; a copy only if it has another type."""
    return np.asarray(_integers(picture, np.dtype(np.uint8)), np.uint8)


def as_uint16(picture: AnyArray) -> NDArray[np.uint16]:
    """The picture with 16 bits a channel, rounded to nearest."""
    return np.asarray(_integers(picture, np.dtype(np.uint16)), np.uint16)


def _integers(picture: AnyArray, dtype: np.dtype[Any]) -> AnyArray:
    if picture.dtype == dtype:
        return picture
    if picture.dtype == np.uint8 and dtype == np.uint16:
        return np.asarray(picture.astype(np.uint16) * np.uint16(257))
    scaled = as_float(picture) * np.float32(FULL[dtype]) + np.float32(0.5)
    return np.asarray(np.clip(scaled, 0, FULL[dtype]), dtype)


def as_float(picture: AnyArray) -> NDArray[np.float32]:
    """The picture as float32 with white at 1; values of a float picture are kept. NaN becomes 0, infinity 65504."""
    if picture.dtype in FULL:
        return np.asarray(picture.astype(np.float32) / np.float32(FULL[picture.dtype]), np.float32)
    return np.nan_to_num(picture.astype(np.float32), posinf=65504, neginf=0)


def with_opacity(picture: AnyArray, opacity: AnyArray) -> AnyArray:
    """RGBA in the type of the picture (h, w, 3), with this opacity, uint8 or uint16 (h, w)."""
    if picture.dtype in FULL:
        return np.dstack([picture[..., :3], _integers(opacity, picture.dtype)])
    return np.dstack([picture[..., :3], as_float(opacity)])


def check_picture(array: object, size: tuple[int, int], channels: int = 3, field: str = "frame") -> AnyArray:
    """The array, C-contiguous, if it is a picture of this (width, height) and number of channels. Raises BadFrame."""
    if not isinstance(array, np.ndarray) or array.dtype not in DTYPES:
        kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
        raise BadFrame("A frame to be encoded is uint8, uint16 or float32.", field=field, value=kind)
    if array.shape != (size[1], size[0], channels):
        shape = f"({size[1]}, {size[0]}, {channels})"
        raise BadFrame(f"A frame of this video has shape {shape}.", field=field, value=array.shape)
    return np.ascontiguousarray(array)
