"""Blobs: bytes by key, on disk or in S3, one contract.

Keys are slash-separated, [A-Za-z0-9._-] in each part, no part "." or ".."; made by us, never by a user.
A blob appears whole or not at all (temporary name, then commit), and a committed blob never changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import BinaryIO, Protocol


class Blobs(Protocol):
    def put(self, key: str, data: bytes | BinaryIO | Path) -> None:
        """Store under `key`, atomically. Putting an existing key again is allowed and keeps one of the two.

        Raises: StorageFull, StorageError.
        """
        ...

    def put_if_absent(self, key: str, data: bytes) -> bool:
        """Store only if there is nothing under `key`; say whether this call stored it."""
        ...

    def get(self, key: str) -> bytes:
        """All bytes. Raises KeyError."""
        ...

    def read(self, key: str, start: int = 0, stop: int | None = None, chunk: int = 1 << 20) -> Iterator[bytes]:
        """Bytes [start, stop) in pieces. Raises KeyError."""
        ...

    def local(self, key: str) -> AbstractContextManager[Path]:
        """A read-only local file with the bytes, for decoders: the file itself on disk, a cached copy from S3."""
        ...

    def size(self, key: str) -> int | None:
        """Bytes, or None if there is no such blob."""
        ...

    def delete(self, key: str) -> None: ...

    def keys(self, prefix: str) -> Iterator[str]: ...

    def check(self) -> None:
        """Raise StorageError if blobs cannot be written and read now (for readyz)."""
        ...
