"""Working size: motion, clusters and warps are computed at reduced resolution, with cells of one to a few pixels.

    a frame of W x H px   ->   w x h working pixels, w = round(W / s), h = round(H / s)

Positions on the grid are like a frame's: the centre of the top left working pixel is (0, 0). Strokes and colours are
always at the frame's own size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame

CELLS = 45_000
"""Reference frame area, px, from which the scale is derived; a frame of 640 x 344 px is reduced to 320 x 172."""
PAPER_HEIGHT = 344
"""Height of the paper's frames, px. Stroke sizes refer to it, so that a painting is alike at any size."""


@dataclass(frozen=True)
class Grid:
    """The working size of a video.

    Attributes:
        width, height: of the frame, px.
        scale: about how many px a working pixel is wide: 1, 1.5, 2, 2.5 ...
    """

    width: int
    height: int
    scale: float

    @classmethod
    def of(cls, size: tuple[int, int]) -> Grid:
        """For frames of (width, height). The scale grows slower than the frame: details of motion matter too."""
        width, height = size
        return cls(width, height, max(1.0, round(2 * (width * height / CELLS) ** 0.4) / 2))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in working px, at least 16 each."""
        return max(round(self.width / self.scale), 16), max(round(self.height / self.scale), 16)

    @property
    def ratio(self) -> tuple[float, float]:
        """Width and height of a working pixel in px, exactly."""
        return self.width / self.size[0], self.height / self.size[1]

    @property
    def unit(self) -> float:
        """Pixels of the frame per pixel of a frame `PAPER_HEIGHT` px high."""
        return self.height / PAPER_HEIGHT

    def small(self, frame: Frame) -> Frame:
        """The frame at the working size."""
        if self.size == (self.width, self.height):
            return frame
        return np.asarray(cv2.resize(frame, self.size, interpolation=cv2.INTER_AREA), np.uint8)

    def shrink_flow(self, flow: NDArray[np.float32]) -> NDArray[np.float32]:
        """A flow of the frame, px, as one of the grid, working px."""
        if self.size == (self.width, self.height):
            return flow
        small = cv2.resize(flow, self.size, interpolation=cv2.INTER_AREA)
        return np.asarray(small / np.array(self.ratio, np.float32), np.float32)

    def enlarge(self, plane: NDArray[Any]) -> NDArray[Any]:
        """A smooth plane of the grid at the frame's size, bilinear."""
        if self.size == (self.width, self.height):
            return plane
        return np.asarray(cv2.resize(plane, (self.width, self.height), interpolation=cv2.INTER_LINEAR))
