"""Conversion between single and half precision by OpenCV, with the same bits as NumPy's, which takes ten times as long:
it converts one number after the other."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import AnyArray


def to_half(values: AnyArray) -> AnyArray:
    """The numbers rounded to the nearest half-precision ones: float16, of the same shape."""
    if values.dtype != np.float32 or not values.size:  # double precision must be rounded once, not twice
        return np.ascontiguousarray(values, np.float16)
    return cv2.convertFp16(_column(values)).view(np.float16).reshape(values.shape)


def to_single(values: AnyArray) -> AnyArray:
    """The numbers, float16, in single precision: float32, of the same shape."""
    if not values.size:
        return np.ascontiguousarray(values, np.float32)
    return np.asarray(cv2.convertFp16(_column(values).view(np.int16)), np.float32).reshape(values.shape)


def _column(values: AnyArray) -> AnyArray:
    """The numbers one below the other, since OpenCV takes two dimensions."""
    return np.ascontiguousarray(values).reshape(-1, 1)
