"""A cache of the artefacts that tasks of a step pass to each other. Blobs remain authoritative.

A chain of tasks passes its state on: an artefact that one task saves is loaded by the next, often on another machine.
If a pool has a faster way than the blob store (Ray's shared memory), the bytes use both. If they are lost in memory,
the blob is read: the cache affects speed only.
"""

from __future__ import annotations

import io
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import BinaryIO

from workers.blobs.base import Blobs, Content, Direct

ARTEFACT = ".npz"
"""Suffix of the keys of artefacts."""
MOST_BYTES = 16 << 20
"""Largest artefact in the cache, bytes; larger ones use the blob store only."""

Fetch = Callable[[], bytes | None]
"""The bytes, or None if they are no longer in memory."""


class ArtefactCache(Blobs):
    """A blob store with some blobs in memory. It serves one attempt after another; each calls `begin`.

    Args:
        blobs: the store itself.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self._lock = threading.Lock()
        self._given: Mapping[str, Fetch] = {}
        self._made: dict[str, bytes] | None = None

    def begin(self, given: Mapping[str, Fetch], keep: bool) -> None:
        """Start an attempt.

        Args:
            given: blobs in memory, by key.
            keep: whether other tasks wait for the attempt's artefacts.
        """
        self._given = given
        self._made = {} if keep else None

    def end(self) -> dict[str, bytes]:
        """The artefacts that the attempt has stored, if they were to be kept."""
        with self._lock:
            made, self._made, self._given = self._made or {}, None, {}
        return made

    def get(self, key: str) -> bytes:
        fetch = self._given.get(key)
        data = None if fetch is None else fetch()
        return self._blobs.get(key) if data is None else data

    def put(self, key: str, data: Content) -> None:
        if self._made is not None and key.endswith(ARTEFACT) and not isinstance(data, Path):
            data = _whole(data)
            self._keep(key, data)
        self._blobs.put(key, data)

    def _keep(self, key: str, data: bytes) -> None:
        with self._lock:
            if self._made is not None and len(data) <= MOST_BYTES:
                self._made[key] = data

    # -- passed on to the store

    def put_if_absent(self, key: str, data: bytes) -> bool:
        return self._blobs.put_if_absent(key, data)

    def read(self, key: str, start: int = 0, stop: int | None = None, chunk: int = 1 << 20) -> Iterator[bytes]:
        return self._blobs.read(key, start, stop, chunk)

    def local(self, key: str) -> AbstractContextManager[Path]:
        return self._blobs.local(key)

    def size(self, key: str) -> int | None:
        return self._blobs.size(key)

    def delete(self, key: str) -> None:
        self._blobs.delete(key)

    def delete_all(self, keys: Iterable[str]) -> None:
        self._blobs.delete_all(keys)

    def keys(self, prefix: str) -> Iterator[str]:
        return self._blobs.keys(prefix)

    def check(self) -> None:
        self._blobs.check()

    def check_free_space(self, wanted_bytes: int = 0) -> None:
        self._blobs.check_free_space(wanted_bytes)

    def sweep(self, older_than_s: float = 3600.0) -> int:
        return self._blobs.sweep(older_than_s)

    @property
    def direct(self) -> Direct | None:
        return self._blobs.direct


def _whole(data: bytes | BinaryIO | Callable[[BinaryIO], None]) -> bytes:
    if isinstance(data, bytes):
        return data
    if not callable(data):
        return data.read()
    stream = io.BytesIO()
    data(stream)
    return stream.getvalue()


class SharedArtefacts:
    """References to the artefacts of recent attempts, up to a total number of bytes. Thread-safe.

    Args:
        most_bytes: maximum of their total size.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most = most_bytes
        self._lock = threading.Lock()
        self._left: OrderedDict[str, tuple[object, int]] = OrderedDict()
        self._bytes = 0

    def add(self, made: Mapping[str, tuple[object, int]]) -> None:
        """Add entries: blob key -> a reference to the bytes, and their number."""
        with self._lock:
            for key, (way, size) in made.items():
                self._left[key] = (way, size)
                self._bytes += size
            while self._bytes > self._most:
                _, (_, size) = self._left.popitem(last=False)
                self._bytes -= size

    def of(self, keys: Iterable[str]) -> dict[str, object]:
        """References to those of the given keys that are in memory."""
        with self._lock:
            return {key: self._left[key][0] for key in keys if key in self._left}
