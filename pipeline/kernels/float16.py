"""Conversion between single and half precision by OpenCV, with the same bits as NumPy's, which takes ten times as long:
it converts one number after the other."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray


def to_half(values: AnyArray) -> NDArray[np.float16]:
    """The numbers rounded to the nearest half-precision ones, ties to even, infinite above 65504: float16, of the same
    shape."""
    if values.dtype != np.float32:  # double precision must be rounded once, not twice
        return np.ascontiguousarray(values, np.float16)
    out = np.empty(values.shape, np.float16)
    _convert(np.asarray(values, order="C"), out.view(np.int16))
    return out


def to_single(values: AnyArray) -> NDArray[np.float32]:
    """The numbers, float16 or float32, in single precision, of the same shape; float32 is returned as it is."""
    if values.dtype != np.float16:
        return np.asarray(values, np.float32)
    out = np.empty(values.shape, np.float32)
    _convert(np.asarray(values, order="C").view(np.int16), out)
    return out


def _convert(values: AnyArray, out: AnyArray) -> None:
    """OpenCV's conversion of contiguous arrays; int16 holds the bits of half precision."""
    if values.size:
        cv2.convertFp16(values.reshape(1, -1), dst=out.reshape(1, -1))
