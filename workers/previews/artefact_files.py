"""Artefacts of films at the size of previews, in files: those of a whole shot exceed the memory of previews."""

from __future__ import annotations

import itertools
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Hashable
from pathlib import Path

from pipeline.arrays import Arrays, State
from workers.execution.arrays import read_arrays, write_arrays

LIMIT_BYTES = 8 << 30
"""Maximum size of all files of a process together."""


class ArtefactFiles:
    """Artefacts by name; the least recently used are deleted first. Thread-safe. Close it.

    Args:
        limit_bytes: maximum size of all files together; the newest one is always kept.
    """

    def __init__(self, limit_bytes: int = LIMIT_BYTES) -> None:
        self._limit_bytes, self._bytes = limit_bytes, 0
        self._folder = tempfile.TemporaryDirectory(prefix="impasto-previews-")
        self._sizes: OrderedDict[Hashable, tuple[Path, int]] = OrderedDict()
        self._numbers = itertools.count()
        self._lock = threading.Lock()

    def close(self) -> None:
        self._folder.cleanup()

    def put(self, name: Hashable, arrays: Arrays) -> None:
        """Keep an artefact, instead of an earlier one of this name."""
        path = Path(self._folder.name) / f"{next(self._numbers)}.npz"
        with path.open("wb") as stream:
            write_arrays(stream, arrays)
        size = path.stat().st_size
        with self._lock:
            self._drop(name)
            self._sizes[name] = path, size
            self._bytes += size
            while self._bytes > self._limit_bytes and len(self._sizes) > 1:
                self._drop(next(iter(self._sizes)))

    def has(self, name: Hashable) -> bool:
        with self._lock:
            if name in self._sizes:
                self._sizes.move_to_end(name)
            return name in self._sizes

    def get(self, name: Hashable) -> State | None:
        """The arrays of an artefact; None: it is not kept."""
        with self._lock:
            if name not in self._sizes:
                return None
            self._sizes.move_to_end(name)
            data = self._sizes[name][0].read_bytes()
        return read_arrays(data)

    def _drop(self, name: Hashable) -> None:
        path, size = self._sizes.pop(name, (None, 0))
        self._bytes -= size
        if path is not None:
            path.unlink(missing_ok=True)
