"""Blobs in a folder. A blob is written to a temporary file, flushed, and renamed, so that it appears whole or not at
all.

root/<key>                   a committed blob
root/~tmp/<random>           a blob that is being written; only a crash leaves one, which the next start removes

The folder ~tmp marks a store: it is made when the store is opened, and nothing is written where it is missing.
"""

from __future__ import annotations

import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import StorageError, StorageFull
from workers.blobs.base import Content, Direct
from workers.blobs.disk_errors import disk_errors
from workers.blobs.keys import NoBlob, check_key
from workers.blobs.verified import check_file, mark_intact

_CHUNK = 1 << 20
_TEMPORARY = "~tmp"
"""Name of the folder of temporary files; "~" is not allowed in keys."""


@dataclass(frozen=True)
class DiskBlobs:
    """The blobs under `root` (made if missing). A plain value that is pickled to workers.

    Args:
        root: the folder; on one machine, or shared by all workers.
        reserve_bytes: `check` fails when less than this is free.
    """

    root: Path
    reserve_bytes: int = 0

    def __post_init__(self) -> None:
        with suppress(OSError):  # the first use reports it
            (self.root / _TEMPORARY).mkdir(parents=True, exist_ok=True)

    def put(self, key: str, data: Content) -> None:
        place = self._place(key)
        with disk_errors(), self._written(data) as temporary:
            _in_folder(place, lambda: temporary.rename(place))
            mark_intact(key, place)

    def put_if_absent(self, key: str, data: bytes) -> bool:
        place = self._place(key)
        with disk_errors(), self._written(data) as temporary:
            try:
                _in_folder(place, lambda: place.hardlink_to(temporary))  # unlike rename, fails if the target exists
            except FileExistsError:
                return False
            return True

    def get(self, key: str) -> bytes:
        with _missing(key), disk_errors():
            check_file(key, self._place(key))
            return self._place(key).read_bytes()

    def read(self, key: str, start: int = 0, stop: int | None = None, chunk: int = _CHUNK) -> Iterator[bytes]:
        with _missing(key), disk_errors():
            file = self._place(key).open("rb")
        return _pieces(file, start, stop, chunk)

    @contextmanager
    def local(self, key: str) -> Iterator[Path]:
        place = self._place(key)
        if not place.is_file():
            raise NoBlob(key)
        with _missing(key), disk_errors():
            check_file(key, place)
        yield place

    def size(self, key: str) -> int | None:
        place = self._place(key)
        with disk_errors():
            return place.stat().st_size if place.is_file() else None

    def delete(self, key: str) -> None:
        place = self._place(key)
        with disk_errors():
            place.unlink(missing_ok=True)
        self._prune(place.parent)

    def delete_all(self, keys: Iterable[str]) -> None:
        for key in keys:
            self.delete(key)

    def keys(self, prefix: str) -> Iterator[str]:
        folder = self.root / prefix.rpartition("/")[0]
        return (key for key in _walk(self.root, folder) if key.startswith(prefix))

    def check(self) -> None:
        """Raise StorageError if a blob cannot be written, StorageFull if less than the reserve is free."""
        with disk_errors(), self._written(b"impasto"):
            self.check_free_space()

    def check_free_space(self, wanted_bytes: int = 0) -> None:
        """Raise StorageFull unless `wanted_bytes` more leave the reserve free. Cheap."""
        with disk_errors():
            free = shutil.disk_usage(self._temporary_folder()).free
        if free < self.reserve_bytes + wanted_bytes:
            raise StorageFull(
                "The disk of the blobs is nearly full.",
                field="free_bytes",
                value=free,
                remedy=f"Free some space: {self.reserve_bytes >> 20} MiB must stay free.",
            )

    def sweep(self, older_than_s: float = 3600.0) -> int:
        """Remove old temporary files that a crash left; returns their number. Newer ones may be in use."""
        before = time.time() - older_than_s
        stale = [file for file in (self.root / _TEMPORARY).glob("*") if file.stat().st_mtime < before]
        for file in stale:
            file.unlink(missing_ok=True)
        return len(stale)

    @property
    def direct(self) -> Direct | None:
        return None

    def _place(self, key: str) -> Path:
        return self.root / check_key(key)

    def _temporary_folder(self) -> Path:
        """The folder of unfinished blobs, made when the store is opened. Where it is missing, the store was deleted or
        its disk is not mounted: new blobs beside no old ones would be lost."""
        folder = self.root / _TEMPORARY
        if not folder.is_dir():
            raise StorageError(
                f"The folder of the blobs is gone or empty: {self.root}.",
                remedy="Mount or restore it, then restart the service. A new store is made at a start.",
            )
        return folder

    @contextmanager
    def _written(self, data: Content) -> Iterator[Path]:
        """A flushed temporary file with `data`, removed at the end if it is still there."""
        temporary = self._temporary_folder() / secrets.token_hex(16)
        try:
            with temporary.open("xb") as file:
                _copy(data, file)
                file.flush()
                os.fsync(file.fileno())
            yield temporary
        finally:
            temporary.unlink(missing_ok=True)

    def _prune(self, folder: Path) -> None:
        """Remove folders that became empty, up to the root."""
        while folder != self.root:
            try:
                folder.rmdir()
            except OSError:
                return
            folder = folder.parent


def _walk(root: Path, folder: Path) -> Iterator[str]:
    """Keys of all blobs under `folder`, in the order of keys, like S3: "a/b" before "a0"."""
    try:
        found = [(f"{entry.name}/" if entry.is_dir() else entry.name, entry) for entry in os.scandir(folder)]
    except (FileNotFoundError, NotADirectoryError):
        return
    for name, entry in sorted(found, key=lambda pair: pair[0]):
        if name.endswith("/"):
            yield from () if entry.name == _TEMPORARY else _walk(root, Path(entry.path))
        else:
            yield Path(entry.path).relative_to(root).as_posix()


def _copy(data: Content, file: BinaryIO) -> None:
    if isinstance(data, bytes):
        file.write(data)
    elif callable(data):
        data(file)
    elif isinstance(data, Path):
        with data.open("rb") as source:
            shutil.copyfileobj(source, file, _CHUNK)
    else:
        shutil.copyfileobj(data, file, _CHUNK)


def _pieces(file: BinaryIO, start: int, stop: int | None, chunk: int) -> Iterator[bytes]:
    with file:
        file.seek(start)
        left = None if stop is None else max(0, stop - start)
        while piece := file.read(chunk if left is None else min(chunk, left)):
            left = None if left is None else left - len(piece)
            yield piece


def _in_folder(place: Path, commit: Callable[[], object]) -> None:
    """Commit a file to its folder; try again if a concurrent `delete` has just removed the folder because it was
    empty."""
    for last in (False, False, True):
        place.parent.mkdir(parents=True, exist_ok=True)
        try:
            commit()
            _flush_folder(place.parent)
        except FileNotFoundError:
            if last:
                raise
        else:
            return


def _flush_folder(folder: Path) -> None:
    """Flush a folder, so that a rename in it survives a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def _missing(key: str) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise NoBlob(key) from None
