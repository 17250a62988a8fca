"""Face detection in one picture (viola2001rapid), in slices of face sizes.

A complete search takes as long as the rest of the processing of a live frame, so it is spread over several frames. The
result is that of one search: the same windows are tested, and the hits of all slices are grouped at the end.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from cv2.data import haarcascades
from numpy.typing import NDArray

from pipeline.errors import DeviceError

Boxes = NDArray[np.float64]
"""(n, 4): centre x, centre y, width, height, px of the picture."""

SLICES = 4
"""Number of slices of a search."""
_WINDOW_PX = 20
"""Side of the cascade's smallest window."""
_MIN_NEIGHBOURS, _GROUP_EPS = 3, 0.2
"""Least number of hits in a group, and the tolerance of grouping, as in OpenCV's detector."""


class FaceDetector:
    """Face detector with OpenCV's cascade, which is read from disk on first use. Not thread-safe."""

    def __init__(self) -> None:
        self._cascade: cv2.CascadeClassifier | None = None

    def find(self, gray: NDArray[np.uint8], factor: float, least_px: int, most_px: int) -> Boxes:
        """Detect faces with sides from `least_px` to `most_px`, in an order that depends on the picture only.

        Args:
            gray: uint8 (h, w).
            factor: ratio of consecutive window sizes.
        """
        return join(self.hits(gray, factor, least_px, most_px))

    def hits(self, gray: NDArray[np.uint8], factor: float, least_px: int, most_px: int) -> NDArray[np.int32]:
        """Windows that the cascade accepts, int32 (n, 4): left, top, width, height; px."""
        if self._cascade is None:
            self._cascade = _load_cascade()
        # Set per thread. Otherwise the cascade opens the system's OpenCL loader, which then hides the registered
        # runtimes.
        cv2.ocl.setUseOpenCL(False)
        found = self._cascade.detectMultiScale(
            gray, factor, 0, minSize=(least_px, least_px), maxSize=(most_px, most_px)
        )
        return np.array(found, np.int32).reshape(-1, 4)


def join(hits: NDArray[np.int32]) -> Boxes:
    """Group overlapping hits into one box each."""
    found, _ = cv2.groupRectangles([tuple(int(v) for v in hit) for hit in hits], _MIN_NEIGHBOURS, _GROUP_EPS)
    boxes = np.array(sorted(tuple(int(v) for v in box) for box in found), np.float64).reshape(-1, 4)
    boxes[:, :2] += boxes[:, 2:] / 2
    return boxes


def slices(factor: float, least_px: int, most_px: int) -> list[tuple[int, int]]:
    """Smallest and largest window size of each of the `SLICES` slices, px; slices have about the same cost.

    The cost of a window size is inversely proportional to its square.
    """
    sizes = [s for s in _sizes(factor, most_px) if s >= least_px]
    if not sizes:
        return [(least_px, most_px)] * SLICES
    done = np.cumsum([1.0 / (s * s) for s in sizes])
    slice_of = np.minimum((done - 0.5 / np.square(sizes)) / done[-1] * SLICES, SLICES - 1).astype(int)
    parts = [[s for s, k in zip(sizes, slice_of, strict=True) if k == n] for n in range(SLICES)]
    return [(part[0], part[-1]) if part else (1, 1) for part in parts]


def _sizes(factor: float, most_px: int) -> list[int]:
    """Window sizes that OpenCV tests, px."""
    found, scale = [], 1.0
    while round(_WINDOW_PX * scale) <= most_px:
        found.append(round(_WINDOW_PX * scale))
        scale *= factor
    return found


def _load_cascade() -> cv2.CascadeClassifier:
    path = Path(haarcascades) / "haarcascade_frontalface_alt2.xml"
    cascade = cv2.CascadeClassifier(str(path))
    if cascade.empty():
        raise DeviceError(
            "OpenCV's face cascade cannot be read.",
            field="opencv",
            value=path,
            remedy="Install opencv-contrib-python-headless 4.x.",
        )
    return cascade
