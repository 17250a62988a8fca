"""Input of the flow solvers: two pictures of one size as brightness."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadFrame
from pipeline.frames import MIN_SIDE_PX, check_frame

Gray: TypeAlias = NDArray[np.uint8]
"""Brightness: `uint8` (height, width)."""


def gray_pair(previous: object, current: object) -> tuple[Gray, Gray]:
    """Brightness of two pictures, each uint8 RGB or gray.

    Raises:
        BadFrame: a picture is invalid, or the sizes differ; `field` names the picture.
    """
    first, second = to_gray(previous, "previous"), to_gray(current, "current")
    if first.shape != second.shape:
        raise BadFrame(
            "The two frames must have the same size.",
            field="current",
            value=f"{second.shape[1]}x{second.shape[0]} instead of {first.shape[1]}x{first.shape[0]}",
        )
    return first, second


def to_gray(picture: object, field: str = "frame") -> Gray:
    """Brightness (Rec. 601 luma of sRGB values) of a frame; a gray uint8 picture is returned unchanged."""
    if not isinstance(picture, np.ndarray) or picture.ndim != 2:
        return np.asarray(cv2.cvtColor(check_frame(picture, field), cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    if picture.dtype != np.uint8 or min(picture.shape) < MIN_SIDE_PX:
        raise BadFrame(
            f"A gray picture must be uint8 with at least {MIN_SIDE_PX} px on each side.",
            field=field,
            value=f"{picture.dtype} {picture.shape[1]}x{picture.shape[0]}",
        )
    return np.ascontiguousarray(picture)
