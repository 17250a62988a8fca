"""The interface of a sink of stylised frames."""

from __future__ import annotations

from abc import ABC, abstractmethod

import cv2
import numpy as np

from impasto.live.sources import Size
from pipeline.frames import Frame


class Sink(ABC):
    """Receives frames in order of time. One thread creates, feeds and finishes it."""

    needs_original = False
    """Whether it also needs the original frames."""

    @abstractmethod
    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        """Show a frame from `when_s` on, seconds after the source's first frame. Its size may differ from that of other
        frames."""

    def is_open(self) -> bool:
        """Called often. Returns False to end the stream."""
        return True

    @abstractmethod
    def finish(self, end_s: float) -> str:
        """Finish; the last frame lasts until `end_s`. Returns the output's path or address, "" without frames."""


def upscaled(frame: Frame, size: Size) -> Frame:
    """The frame at `size`: answers of a lower work resolution are enlarged."""
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_LINEAR), np.uint8)
