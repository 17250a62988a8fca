"""Blobs: bytes by key, on disk or in S3, one contract.

Keys are slash-separated, [A-Za-z0-9._-] in each part, no part "." or ".."; made by us, never by a user.
A blob appears whole or not at all (temporary name, then commit), and a committed blob never changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import BinaryIO, Protocol, TypeAlias

Content: TypeAlias = bytes | BinaryIO | Path | Callable[[BinaryIO], None]
"""Content of a new blob: bytes, a stream, a file, or a function that writes it to a seekable file."""


class Direct(Protocol):
    """Direct access to a store through signed URLs that expire, without this service in between."""

    def download_url(self, key: str, filename: str, media_type: str, seconds: int = 3600) -> str:
        """GET gives the blob, as a file of that name and type."""
        ...


class Blobs(Protocol):
    def put(self, key: str, data: Content) -> None:
        """Store under `key`, atomically. Putting an existing key again is allowed and keeps one of the two.

        Raises: StorageFull, StorageError.
        """
        ...

    def put_if_absent(self, key: str, data: bytes) -> bool:
        """Store only if there is nothing under `key`; returns whether this call stored it.

        Of several simultaneous calls one wins on a disk and on servers with a single point of decision (Amazon's).
        Nothing in Impasto relies on that: the database decides which caller is first.
        """
        ...

    def get(self, key: str) -> bytes:
        """All bytes. Raises KeyError, DamagedBlob (an asset on a disk that has changed its bytes)."""
        ...

    def read(self, key: str, start: int = 0, stop: int | None = None, chunk: int = 1 << 20) -> Iterator[bytes]:
        """Bytes [start, stop) in pieces. Raises KeyError."""
        ...

    def local(self, key: str) -> AbstractContextManager[Path]:
        """A read-only local file with the bytes, for decoders: the file itself on disk, a cached copy from S3. An asset
        is compared with its hash when the process first opens it. Raises KeyError, DamagedBlob."""
        ...

    def size(self, key: str) -> int | None:
        """Bytes, or None if there is no such blob."""
        ...

    def delete(self, key: str) -> None: ...

    def delete_all(self, keys: Iterable[str]) -> None:
        """Delete many, in as few requests as possible."""
        ...

    def keys(self, prefix: str) -> Iterator[str]:
        """Keys that begin with `prefix`, in order."""
        ...

    def check(self) -> None:
        """Raise StorageError if blobs cannot be written and read now. Used by /readyz."""
        ...

    def check_free_space(self, wanted_bytes: int = 0) -> None:
        """Raise StorageFull unless `wanted_bytes` more can be stored. Cheap."""
        ...

    def sweep(self, older_than_s: float = 3600.0) -> int:
        """Remove unfinished leftovers of crashed writers that are older than this; returns their number."""
        ...

    @property
    def direct(self) -> Direct | None:
        """Direct access by signed URLs; None if the store has none."""
        ...
