"""Thumbnails of a video that are read before somebody asks for them: while a command starts, a processor is idle."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.video.guard.decoder_process import DecoderProcess
from pipeline.video.guard.reader import FOREVER, GuardedReader
from pipeline.video.guard.wire import Message

NICENESS = 5
"""Added to the niceness of the decoder, so that it takes little time from the start of the command. More would delay it
on a machine that is busy with other work."""
_MOST_ANSWERS = 128
"""Answers that wait, each of 16 thumbnails: 14 MB; the decoder waits when there are more."""
_CHECK_S = 0.2

_Answer = tuple[Message, NDArray[np.float32]]


class ReaderAhead(GuardedReader):
    """A `GuardedReader` of all thumbnails of a video, in their order, once. It reads them in a thread of its own.

    Raises: as `GuardedReader`.
    """

    def __init__(self, path: Path) -> None:
        self._closed = False
        super().__init__(path, niceness=NICENESS)
        self._waiting: queue.Queue[_Answer | Exception] = queue.Queue(_MOST_ANSWERS)
        self._thread = threading.Thread(target=self._read_all, name="impasto-thumbnails", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closed = True
        super().close()

    def _begin(self) -> DecoderProcess:
        child = super()._begin()
        if self._closed:  # meanwhile, while the thread replaces a child that has died
            child.close()
        return child

    def _thumbnails(self, start: int, stop: int) -> Iterator[_Answer]:
        if (start, stop) != (0, FOREVER):
            raise ValueError(f"it reads all frames, not [{start}, {stop})")
        while True:
            answer = self._waiting.get()
            if isinstance(answer, Exception):
                raise answer
            yield answer
            if "end" in answer[0]:
                return

    def _read_all(self) -> None:
        try:
            for answer in super()._thumbnails(0, FOREVER):
                self._wait_and_put(answer)
        except Exception as error:  # raised again where the thumbnails are needed
            self._wait_and_put(error)

    def _wait_and_put(self, answer: _Answer | Exception) -> None:
        while not self._closed:
            try:
                self._waiting.put(answer, timeout=_CHECK_S)
                return
            except queue.Full:
                continue


class ThumbnailsAhead:
    """Begins to read the thumbnails of a file in the background. Close it.

    Args:
        path: a file that may be a video.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._facts = path, _facts(path)
        self._reader: ReaderAhead | None = None
        self._closed = False
        self._lock = threading.Lock()
        self._opening = threading.Thread(target=self._open, name="impasto-thumbnails", daemon=True)
        self._opening.start()

    def reader(self) -> ReaderAhead | None:
        """The reader, for one user, who closes it; None if the file cannot be read, has changed, or this is closed."""
        self._opening.join()
        with self._lock:
            found, self._reader = self._reader, None
        if found is not None and _facts(self._path) != self._facts:
            found.close()
            return None
        return found

    def reads(self, path: Path) -> bool:
        """Whether this is the file, unchanged since its thumbnails were begun."""
        return self._facts is not None and _facts(path) == self._facts

    def close(self) -> None:
        with self._lock:
            self._closed = True
            if self._reader is not None:
                self._reader.close()
                self._reader = None

    def _open(self) -> None:
        try:
            reader = ReaderAhead(self._path)
        except Exception:  # whoever reads the file next reports it
            return
        with self._lock:
            if not self._closed:
                self._reader = reader
                return
        reader.close()


def _facts(path: Path) -> tuple[int, ...] | None:
    """Device, inode, size and time of the last change of a file; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns
