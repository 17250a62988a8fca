"""Whether faces survive: how many of the faces found in the source are found at the same place in the painting."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from cv2.data import haarcascades
from numpy.typing import NDArray

from pipeline.errors import DeviceError
from pipeline.frames import Frame

_CASCADE = "haarcascade_frontalface_default.xml"
_SCALE_FACTOR, _MIN_SIDE_PX = 1.05, 20
_SOURCE_NEIGHBOURS, _PAINTED_NEIGHBOURS = 6, 3
"""Hits that a face needs: more in the source, so that only clear faces are counted."""
_LEAST_OVERLAP = 0.4
_SEARCH_WIDTH_PX = 640
"""Wider frames are searched at this width: the search costs in proportion to the pixels, and was most of a report."""


class FacesKept(NamedTuple):
    """Numbers of faces."""

    found: int
    """Number of faces in the source."""
    kept: int
    """Number of those faces that are also found in the painting."""


class FaceCounter:
    """Counts frontal faces with OpenCV's cascade (viola2001rapid). Not thread-safe.

    Raises: DeviceError (OpenCV lacks the cascade file).
    """

    def __init__(self) -> None:
        self._cascade = cv2.CascadeClassifier(str(Path(haarcascades) / _CASCADE))
        if self._cascade.empty():
            raise DeviceError(
                f"OpenCV has no {_CASCADE}.", remedy="Install opencv-contrib-python-headless, which contains it."
            )

    def count(self, source: Frame, painted: Frame) -> FacesKept:
        """Faces of one frame; a face is kept if a face of the painting overlaps it by more than 0.4 (intersection over
        union). Frames wider than 640 px are searched at that width, so that faces below 20 px there are not found."""
        source, painted = _searched(source), _searched(painted)
        faces = self._find(source, _SOURCE_NEIGHBOURS)
        if not len(faces):
            return FacesKept(0, 0)
        there = self._find(painted, _PAINTED_NEIGHBOURS)
        return FacesKept(
            len(faces), sum(any(_overlap(face, other) > _LEAST_OVERLAP for other in there) for face in faces)
        )

    def _find(self, frame: Frame, neighbours: int) -> NDArray[np.int32]:
        cv2.ocl.setUseOpenCL(False)  # a cascade otherwise opens OpenCL runtimes on this thread
        gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        found = self._cascade.detectMultiScale(gray, _SCALE_FACTOR, neighbours, minSize=(_MIN_SIDE_PX, _MIN_SIDE_PX))
        return np.array(found, np.int32).reshape(-1, 4)


def _searched(frame: Frame) -> Frame:
    """The frame, shrunk if it is wide."""
    height, width = frame.shape[:2]
    if width <= _SEARCH_WIDTH_PX:
        return frame
    size = (_SEARCH_WIDTH_PX, max(1, round(height * _SEARCH_WIDTH_PX / width)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)


def _overlap(one: NDArray[np.int32], other: NDArray[np.int32]) -> float:
    """Intersection over union of two boxes (left, top, width, height)."""
    left, top = np.maximum(one[:2], other[:2])
    right, bottom = np.minimum(one[:2] + one[2:], other[:2] + other[2:])
    common = max(0, int(right - left)) * max(0, int(bottom - top))
    return common / (int(one[2] * one[3]) + int(other[2] * other[3]) - common)
