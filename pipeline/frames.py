"""Array types of frames, flow fields, label maps and masks, and the validator of frames.

A *frame* is a C-contiguous `uint8` array of shape (height, width, 3): red, green, blue, sRGB-encoded, range 0..255,
row 0 at the top. Positions are (x, y) in pixels, x right, y down, the centre of the top left pixel at (0, 0).
A *flow* is `float32` (height, width, 2): (dx, dy) in pixels. A *label map* is `int32` (height, width), 0 = no label.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadFrame

Frame: TypeAlias = NDArray[np.uint8]
Flow: TypeAlias = NDArray[np.float32]
Labels: TypeAlias = NDArray[np.int32]
Mask: TypeAlias = NDArray[np.bool_]
Plane: TypeAlias = NDArray[np.float32]
"""One scalar per pixel: `float32` (height, width)."""

Pixels = TypeVar("Pixels", bound=NDArray[Any])

MIN_SIDE_PX = 16
"""Minimum width and height that the methods accept; the neighbourhoods of the papers do not fit smaller images."""


def check_frame(array: object, field: str = "frame") -> Frame:
    """Return `array` as a C-contiguous frame.

    Args:
        field: name of the array in error messages.

    Raises:
        BadFrame: `array` is not an array, or has a wrong dtype, a wrong shape or a side below `MIN_SIDE_PX`.
    """
    if not isinstance(array, np.ndarray):
        raise BadFrame("A frame is a NumPy array.", field=field, value=type(array).__name__)
    if array.dtype != np.uint8:
        raise BadFrame("A frame has dtype uint8.", field=field, value=array.dtype, remedy="Scale it to 0..255 first.")
    if array.ndim != 3 or array.shape[2] != 3:
        raise BadFrame("A frame has shape (height, width, 3).", field=field, value=array.shape)
    if min(array.shape[:2]) < MIN_SIDE_PX:
        raise BadFrame(
            f"A frame is at least {MIN_SIDE_PX} px on each side.",
            field=field,
            value=f"{array.shape[1]}x{array.shape[0]}",
            remedy="Use a larger video.",
        )
    return np.ascontiguousarray(array)


def same_size(array: Pixels, size: tuple[int, int], field: str = "frame") -> Pixels:
    """Return `array` unchanged; raises `BadFrame` if its (width, height) differs from `size`."""
    if (array.shape[1], array.shape[0]) != size:
        raise BadFrame(
            "Every frame of a video has one size.",
            field=field,
            value=f"{array.shape[1]}x{array.shape[0]} instead of {size[0]}x{size[1]}",
        )
    return array
