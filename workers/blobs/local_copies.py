"""Local copies of remote blobs, because decoders need files. Shared by all processes of a machine.

folder/<name>           a copy; locked shared while in use; the oldest unused copies are removed when there are too many
folder/<name>.lock      locked by the process that fetches it, so that a film is fetched once and not once per worker
folder/<name>.<x>.part  a copy that is being fetched; left behind only by a crash
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import StorageFull
from workers.blobs.disk_errors import disk_errors


@dataclass(frozen=True)
class LocalCopies:
    """A folder of copies with a limited size.

    Args:
        folder: created if missing.
        most_bytes: above this, unused copies are removed, least recently used first.
        reserve_bytes: free space on the disk that is always left.
    """

    folder: Path
    most_bytes: int
    reserve_bytes: int = 0

    @contextmanager
    def file(self, name: str, size: int, fetch: Callable[[Path], None]) -> Iterator[Path]:
        """The copy `name`. If there is none, `fetch` writes it to the path that it receives."""
        self._make_folder()
        place = self.folder / name
        while (handle := _lock(place)) is None:
            self._fetch(place, size, fetch)
        try:
            os.utime(place)
            yield place
        finally:
            os.close(handle)

    def check_free_space(self, wanted_bytes: int = 0) -> None:
        """Remove copies until `wanted_bytes` more leave the reserve free, or raise StorageFull."""
        self._make_folder()
        require_extra = self.reserve_bytes + wanted_bytes
        if self._free() < require_extra:
            self._shrink(lambda kept: self._free() < require_extra)
        if self._free() < require_extra:
            raise StorageFull(
                "The disk for local copies of blobs is nearly full.",
                field="free_bytes",
                value=self._free(),
                remedy=f"Free some space: {require_extra >> 20} MiB are needed at {self.folder}.",
            )

    def sweep(self, older_than_s: float) -> int:
        """Remove the leftovers of crashed fetches; returns their number."""
        before = time.time() - older_than_s
        left = [*self.folder.glob("*.part"), *self.folder.glob("*.lock")]
        stale = [file for file in left if _modified(file) < before]
        for file in stale:
            file.unlink(missing_ok=True)
        return len(stale)

    def _fetch(self, place: Path, size: int, fetch: Callable[[Path], None]) -> None:
        with _alone(place.with_name(f"{place.name}.lock")):
            if place.exists():
                return
            self._shrink(lambda kept: kept + size > self.most_bytes)
            self.check_free_space(size)
            temporary = place.with_name(f"{place.name}.{secrets.token_hex(8)}.part")
            try:
                with disk_errors():
                    fetch(temporary)
                    temporary.rename(place)
            finally:
                temporary.unlink(missing_ok=True)

    def _make_folder(self) -> None:
        with disk_errors():
            self.folder.mkdir(parents=True, exist_ok=True)

    def _free(self) -> int:
        return shutil.disk_usage(self.folder).free

    def _shrink(self, too_much: Callable[[int], bool]) -> None:
        """Remove unused copies, oldest first, while their sum is `too_much`."""
        copies = [file for file in self.folder.iterdir() if not file.suffix]
        kept = sum(_size(file) for file in copies)
        for file in sorted(copies, key=_modified):
            if not too_much(kept):
                return
            size = _size(file)
            kept -= size if _remove_unused(file) else 0


def _lock(place: Path) -> int | None:
    """A shared lock on the copy, as an open file; None if there is no copy (any more)."""
    try:
        handle = os.open(place, os.O_RDONLY)
    except FileNotFoundError:
        return None
    fcntl.flock(handle, fcntl.LOCK_SH)
    if os.fstat(handle).st_nlink:
        return handle
    os.close(handle)  # removed between our open and our lock
    return None


def _remove_unused(place: Path) -> bool:
    try:
        handle = os.open(place, os.O_RDONLY)
    except FileNotFoundError:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        place.unlink(missing_ok=True)
    except BlockingIOError:
        return False
    finally:
        os.close(handle)
    return True


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Hold the exclusive lock of a copy: one process and one thread at a time."""
    handle = os.open(lock, os.O_CREAT | os.O_RDWR, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(handle)


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except FileNotFoundError:
        return 0


def _modified(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except FileNotFoundError:
        return float("inf")
