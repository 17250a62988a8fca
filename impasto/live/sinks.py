"""Sinks of stylised frames: video file, numbered frames, network stream (`broadcast`), window (`window`)."""

from __future__ import annotations

from abc import ABC, abstractmethod

import cv2
import numpy as np

from impasto.delivery import Target, forget, swap, target
from impasto.live.sources import Size, Source
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.video.stills import encode_png


class Sink(ABC):
    """Receives frames in order of time. One thread creates, feeds and finishes it."""

    beside = False
    """Whether it also needs the original frames."""

    @abstractmethod
    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        """A frame shown from `when_s` on, seconds from the source's first. Of any size: that of the work may change."""

    def attend(self) -> bool:
        """Called often. Returns False to end the stream."""
        return True

    @abstractmethod
    def finish(self, end_s: float) -> str:
        """Finish; the last frame lasts until `end_s`. Returns the output's path or address, "" without frames."""


def open_sink(text: str, source: Source, quality: int) -> Sink:
    """A sink by its name: a file, a folder (`DIR/`), rtmp://..., `window`, or `none` (frames are counted, not kept).

    Raises: BadInput.
    """
    if text == "none":
        return NullSink()
    if text == "window":
        from impasto.live.window import Window

        return Window(source.size)
    if "://" in text:
        from impasto.live.broadcast import Broadcast

        return Broadcast(text, source.size, source.fps)
    where = target(text)
    if where.kind == "still" or where.path.suffix == ".zip":
        remedy = "Use a .mp4 or .webm file, or DIR/ for numbered frames."
        raise BadInput("The output is not a known sink.", field="--output", value=text, remedy=remedy)
    if where.kind == "frames":
        return Frames(where)
    from impasto.live.video_file import VideoFileSink

    return VideoFileSink(where, source, quality)


class NullSink(Sink):
    """Discards frames, for measurements."""

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        return

    def finish(self, end_s: float) -> str:
        return "none"


class Frames(Sink):
    """A folder of PNGs, numbered from 0000 in the order of answers. It replaces one of an earlier run at the end."""

    def __init__(self, where: Target) -> None:
        self._where, self._count = where, 0
        self._part = where.path.with_name(f".{where.path.name}.part")

    def put(self, when_s: float, frame: Frame, original: Frame | None) -> None:
        if not self._count:
            forget(self._part)
            self._part.mkdir(parents=True)
        (self._part / f"{self._count:04d}.png").write_bytes(encode_png(frame))
        self._count += 1

    def finish(self, end_s: float) -> str:
        if not self._count:
            return ""
        swap(self._part, self._where.path)
        return str(self._where.path)


def at_size(frame: Frame, size: Size) -> Frame:
    """The frame at `size`: answers of a lower work resolution are enlarged."""
    if (frame.shape[1], frame.shape[0]) == size:
        return frame
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_LINEAR), np.uint8)
