"""Open decoders, kept between tasks, so that the next run of frames continues without a seek. Workers that are threads
of one process share them.

Uploaded files are decoded by child processes (`pipeline.video.guard`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from threading import Lock

from pipeline.errors import UnreadableMedia
from pipeline.frames import Frame
from pipeline.video.guard.decoder_process import ANSWER_S
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.media import Limits, SourceOptions
from workers.blobs.base import Blobs
from workers.process.heartbeat import heartbeats_of_another

IDLE = 3
"""Idle readers of a worker that stay open."""
DEFAULT_OPTIONS = SourceOptions()


@dataclass(frozen=True)
class _Open:
    key: str
    options: SourceOptions
    reader: GuardedReader
    exit_stack: ExitStack
    """Closes the reader, then releases the local file."""


class Decoders:
    """Readers of blobs. An idle reader serves one user at a time; the least recently used are closed. Thread-safe.

    Args:
        idle: maximum number of idle readers that stay open.
    """

    def __init__(self, blobs: Blobs, limits: Limits | None = None, idle: int = IDLE) -> None:
        self._blobs = blobs
        self._limits = limits or Limits()
        self._most = idle
        self._idle: list[_Open] = []
        self._lock = Lock()

    @contextmanager
    def reader(self, key: str, start: int = 0, options: SourceOptions = DEFAULT_OPTIONS) -> Iterator[GuardedReader]:
        """A reader of the blob, preferably one whose next frame is `start`. Raises KeyError, BadMedia."""
        borrowed = self._borrow(key, start, options) or self._open(key, options)
        try:
            yield borrowed.reader
        except BaseException as error:
            if not isinstance(error, GeneratorExit):
                borrowed.exit_stack.close()
                raise
            self._give_back(borrowed)
            raise
        self._give_back(borrowed)

    def close(self) -> None:
        with self._lock:
            closing, self._idle = self._idle, []
        for unused in closing:
            unused.exit_stack.close()

    def _borrow(self, key: str, start: int, options: SourceOptions) -> _Open | None:
        with self._lock:
            fitting = [o for o in self._idle if o.key == key and o.options == options]
            if not fitting:
                return None
            chosen = min(fitting, key=lambda o: _distance(o.reader.position, start))
            self._idle.remove(chosen)
            return chosen

    def _open(self, key: str, options: SourceOptions) -> _Open:
        with ExitStack() as stack:
            path = stack.enter_context(self._blobs.local(key))
            with heartbeats_of_another(ANSWER_S):  # it reads the whole file for the index
                reader = stack.enter_context(GuardedReader(path, self._limits, options))
            return _Open(key, options, reader, stack.pop_all())

    def _give_back(self, borrowed: _Open) -> None:
        with self._lock:
            self._idle.append(borrowed)
            closing, self._idle = self._idle[: -self._most], self._idle[-self._most :]
        for unused in closing:
            unused.exit_stack.close()


def frame_at(reader: GuardedReader, number: int) -> Frame:
    """Frame `number` of an open reader, or its last frame if the index is shorter.

    Raises: UnreadableMedia (the file is damaged there: containers may list frames that do not decode).
    """
    at = min(max(number, 0), reader.frames - 1)
    frame = next(reader.read(at, at + 1), None) if at >= 0 else None
    if frame is None:
        raise UnreadableMedia(
            "This frame of the video cannot be decoded: the file is cut off or damaged.",
            field="frame",
            value=number,
            remedy="Choose an earlier frame, or upload the video again.",
        )
    return frame


def _distance(position: int | None, start: int) -> float:
    """Number of frames that a reader must decode to reach the frame; a seek costs more than any distance forwards."""
    return start - position if position is not None and position <= start else float("inf")
