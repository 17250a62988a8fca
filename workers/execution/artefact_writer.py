"""Stores the artefacts of an attempt on threads, so that their flushes to the disk do not wait for each other."""

from __future__ import annotations

import io
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from pipeline.methods.base import Arrays
from workers.blobs.base import Blobs
from workers.execution.arrays import write_arrays

_THREADS = 4
_LARGE_BYTES = 16 << 20
"""Arrays of this many bytes are stored at once, to bound the memory of artefacts that wait."""
_MOST_WAITING = 8
"""Number of artefacts that may wait; then `put` waits for the first of them."""


class ArtefactWriter:
    """Stores arrays by key. Not thread-safe. Close it.

    On a disk a flush takes about ten milliseconds, and a task may save a dozen artefacts.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self._threads: ThreadPoolExecutor | None = None
        self._waiting: list[Future[None]] = []

    def put(self, key: str, arrays: Arrays) -> None:
        """Store the present contents of the arrays. Errors of the store may be raised by a later call, or by
        `finish`."""
        if sum(np.asarray(array).nbytes for array in arrays.values()) >= _LARGE_BYTES:
            self._blobs.put(key, lambda stream: write_arrays(stream, arrays))
            return
        data = io.BytesIO()
        write_arrays(data, arrays)
        self._wait_until(_MOST_WAITING - 1)
        self._threads = self._threads or ThreadPoolExecutor(_THREADS, thread_name_prefix="artefacts")
        self._waiting.append(self._threads.submit(self._blobs.put, key, data.getvalue()))

    def finish(self) -> None:
        """Wait until everything is stored. Raises the errors of the store."""
        self._wait_until(0)

    def close(self) -> None:
        """Forget artefacts that still wait, and end the threads."""
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)

    def _wait_until(self, most: int) -> None:
        while len(self._waiting) > most:
            self._waiting.pop(0).result()
