"""Looking for faces in one picture (viola2001rapid), a slice of face sizes at a time.

The whole search takes as long as all else that is done for a frame of a stream: in slices, no frame is late for it.
The answer is that of one search: the same windows are tried, and what they found is joined at the end.
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
_WINDOW_PX = 20
"""Side of the cascade's smallest window."""
_MIN_NEIGHBOURS, _GROUP_EPS = 3, 0.2
"""OpenCV's own way to join hits, with its tolerance."""


class FaceDetector:
    """The cascade; read from disk on first use. Not thread-safe."""

    def __init__(self) -> None:
        self._cascade: cv2.CascadeClassifier | None = None

    def find(self, gray: NDArray[np.uint8], factor: float, least_px: int, most_px: int) -> Boxes:
        """Faces between two sizes, in an order that depends on the picture alone. `factor`: from size to size."""
        return join(self.hits(gray, factor, least_px, most_px))

    def hits(self, gray: NDArray[np.uint8], factor: float, least_px: int, most_px: int) -> NDArray[np.int32]:
        """Every window that looks like a face, (n, 4): left, top, width, height."""
        if self._cascade is None:
            self._cascade = _load_cascade()
        # Per thread: a cascade else opens the system's OpenCL loader, which then hides the runtimes we set up.
        cv2.ocl.setUseOpenCL(False)
        found = self._cascade.detectMultiScale(
            gray, factor, 0, minSize=(least_px, least_px), maxSize=(most_px, most_px)
        )
        return np.array(found, np.int32).reshape(-1, 4)


def join(hits: NDArray[np.int32]) -> Boxes:
    """Hits that overlap enough of each other, as one box each."""
    found, _ = cv2.groupRectangles([tuple(int(v) for v in hit) for hit in hits], _MIN_NEIGHBOURS, _GROUP_EPS)
    boxes = np.array(sorted(tuple(int(v) for v in box) for box in found), np.float64).reshape(-1, 4)
    boxes[:, :2] += boxes[:, 2:] / 2
    return boxes


def slices(factor: float, least_px: int, most_px: int) -> list[tuple[int, int]]:
    """(least, most) window sizes of `SLICES` searches of about the same cost, which falls with their square."""
    sizes = [s for s in _sizes(factor, most_px) if s >= least_px]
    if not sizes:
        return [(least_px, most_px)] * SLICES
    done = np.cumsum([1.0 / (s * s) for s in sizes])
    slice_of = np.minimum((done - 0.5 / np.square(sizes)) / done[-1] * SLICES, SLICES - 1).astype(int)
    parts = [[s for s, k in zip(sizes, slice_of, strict=True) if k == n] for n in range(SLICES)]
    return [(part[0], part[-1]) if part else (1, 1) for part in parts]


def _sizes(factor: float, most_px: int) -> list[int]:
    """The window sizes that OpenCV tries."""
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
