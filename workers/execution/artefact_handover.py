"""Arrays on their way from the task that saved them to the next task in this process, without the blob store.

A chain of tasks passes its state on, and in a pool of threads the next task runs in the same process. Reading a blob
costs a copy, a checksum and the parsing of hundreds of entries. Blobs remain authoritative: what is not here, after a
restart or because there was too much, is read from them. The hand-over affects speed only.

Artefacts of most methods are read once, and leave with their first reader. Those of a method that reads them again stay
until there is no room.
"""

from __future__ import annotations

import threading
from collections import OrderedDict

import numpy as np

from pipeline.arrays import Arrays, State

MOST_BYTES = 128 << 20
"""Maximum size of all arrays that wait, bytes; those that were read least recently are dropped."""


class ArtefactHandover:
    """Saved artefacts by blob key. Thread-safe.

    Args:
        most_bytes: maximum of their total size.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most = most_bytes
        self._lock = threading.Lock()
        self._waiting: OrderedDict[str, tuple[State, int]] = OrderedDict()
        self._bytes = 0

    def give(self, key: str, arrays: Arrays) -> State | None:
        """Keep copies of the arrays for the task that loads them; the copies, None if there is not enough room."""
        size = sum(np.asarray(array).nbytes for array in arrays.values())
        if size > self._most:
            return None
        copies = {name: np.array(arrays[name], order="C") for name in sorted(arrays)}
        with self._lock:
            self._waiting[key] = copies, size
            self._bytes += size
            while self._bytes > self._most:
                self._bytes -= self._waiting.popitem(last=False)[1][1]
        return copies

    def take(self, key: str) -> State | None:
        """The arrays, which are the caller's own from then on; None if they are not here or have been taken."""
        with self._lock:
            arrays, size = self._waiting.pop(key, (None, 0))
            self._bytes -= size
        return arrays

    def copy(self, key: str) -> State | None:
        """Copies of the arrays, which stay here; None if they are not here."""
        with self._lock:
            arrays, _ = self._waiting.get(key, (None, 0))
            if arrays is None:
                return None
            self._waiting.move_to_end(key)
        return {name: array.copy() for name, array in arrays.items()}
