"""Decoded frames, kept in memory for the tasks of this process that read them next.

Some methods read each frame in several tasks: for flow, for faces, for each patch, for the result. Reading a frame from
a decoder process costs decoding, two copies and two messages; a file with few keyframes is also decoded from the last
one before the frame. The cache affects speed only.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator
from typing import Protocol

from pipeline.frames import Frame

MOST_BYTES = 112 << 20
"""Maximum size of all frames that are kept, bytes; the least recently used are dropped. 120 frames of 640x480 fit."""


class Reader(Protocol):
    """A decoder, as `pipeline.video.guard.reader.GuardedReader`."""

    errors: list[str]
    unreadable: list[int]

    def read(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]: ...


class FrameCache:
    """Frames by blob key and number. Thread-safe.

    Args:
        most_bytes: maximum of their total size.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most, self._bytes = most_bytes, 0
        self._lock = threading.Lock()
        self._frames: OrderedDict[tuple[str, int], Frame] = OrderedDict()

    def first_missing(self, key: str, start: int) -> int:
        """The first frame from `start` on that is not here."""
        with self._lock:
            while (key, start) in self._frames:
                start += 1
        return start

    def read(self, key: str, reader: Reader, start: int, stop: int | None = None) -> Iterator[Frame]:
        """Frames [start, stop) in order, as those of the reader: fewer if the video ends earlier. The frames are the
        caller's own. Frames that were damaged are not kept, so that every reader notes the damage."""
        at = start
        while stop is None or at < stop:
            while (stop is None or at < stop) and (found := self._get(key, at)) is not None:
                yield found
                at += 1
            began = at
            for frame in self._decoded(key, reader, at, stop):
                yield frame
                at += 1
                if self.first_missing(key, at) > at:
                    break
            if at == began:
                return

    def _decoded(self, key: str, reader: Reader, start: int, stop: int | None) -> Iterator[Frame]:
        """Frames [start, stop) from the reader; they are kept."""
        if start == stop:
            return
        faults = len(reader.errors) + len(reader.unreadable)
        for at, frame in enumerate(reader.read(start, stop), start=start):
            if faults == len(reader.errors) + len(reader.unreadable):
                self._put(key, at, frame)
            faults = len(reader.errors) + len(reader.unreadable)
            yield frame

    def _get(self, key: str, number: int) -> Frame | None:
        with self._lock:
            found = self._frames.get((key, number))
            if found is None:
                return None
            self._frames.move_to_end((key, number))
        return found.copy()

    def _put(self, key: str, number: int, frame: Frame) -> None:
        if frame.nbytes > self._most:
            return
        own = frame.copy()
        with self._lock:
            if (key, number) in self._frames:
                return
            self._frames[key, number] = own
            self._bytes += own.nbytes
            while self._bytes > self._most:
                self._bytes -= self._frames.popitem(last=False)[1].nbytes
