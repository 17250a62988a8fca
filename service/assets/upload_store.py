"""Unfinished uploads on disk: `<id>.json` describes the upload, `<id>.part` contains its bytes; its size is the offset.

Nothing is kept in memory, so uploads survive a restart. A lock on the part file excludes a second writer, also one in
another process.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import ImpastoError
from service.errors import Gone, Locked, retry_after
from workers.contract.record import Fault
from workers.errors import NotFound


@dataclass(frozen=True)
class Upload:
    """A resumable upload. Once complete, `asset_id` names its asset, or `fault` holds the error that refused it."""

    id: str
    owner: str
    filename: str
    metadata: str
    """The header Upload-Metadata, which tus returns at HEAD."""
    length: int
    asset_id: str | None = None
    fault: Fault | None = None

    @property
    def closed(self) -> bool:
        """Whether it has become an asset or was refused."""
        return self.asset_id is not None or self.fault is not None


@dataclass(frozen=True)
class Reservation:
    """Disk space and quota that are reserved for open uploads."""

    missing_bytes: int
    """Missing bytes of all open uploads, for which disk space is needed."""
    owned_bytes: dict[str, int]
    """Owner -> announced bytes of their open uploads."""
    counts: dict[str, int]
    """Owner -> number of their open uploads."""


class UploadStore:
    """The uploads of one folder.

    Args:
        folder: made when needed.
        ttl_s: an upload without new bytes for this long has expired, seconds.
        clock: seconds since the epoch.
    """

    def __init__(self, folder: Path, ttl_s: float, clock: Callable[[], float] = time.time) -> None:
        self._folder, self._ttl_s, self._clock = folder, ttl_s, clock

    def create(self, owner: str, filename: str, metadata: str, length: int) -> Upload:
        upload = Upload("upl_" + secrets.token_urlsafe(18), owner, filename, metadata, length)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._part(upload.id).touch(mode=0o600)
        self._write(upload)
        return upload

    def find(self, upload_id: str) -> Upload:
        """Raises: NotFound, Gone (expired)."""
        try:
            row = json.loads(self._info(upload_id).read_text())
        except FileNotFoundError:
            raise NotFound("Upload not found.", field="upload_id", value=upload_id, remedy="Begin a new one.") from None
        upload = Upload(**row | {"fault": row["fault"] and Fault(**row["fault"])})
        if self.expires_at(upload) < self._clock():
            raise Gone("The upload has expired.", field="upload_id", value=upload_id, remedy="Begin a new one.")
        return upload

    def offset(self, upload: Upload) -> int:
        """Bytes that have arrived. Raises: NotFound (removed, or closed since `upload` was read)."""
        if upload.closed:
            return upload.length
        try:
            return self._part(upload.id).stat().st_size
        except FileNotFoundError:
            raise _finished(upload.id) from None

    def open_uploads(self) -> Iterator[Upload]:
        """Every upload that still waits for bytes or for its probe, and has not expired."""
        for path in self._folder.glob("*.json"):
            with suppress(NotFound, Gone):
                upload = self.find(path.stem)
                if not upload.closed:
                    yield upload

    def reserved(self) -> Reservation:
        """Bytes that all open uploads together may still occupy."""
        rows = [(upload.owner, upload.length, self._part_bytes(upload.id)) for upload in self.open_uploads()]
        owned: dict[str, int] = {}
        counts: dict[str, int] = {}
        for owner, length, _ in rows:
            owned[owner] = owned.get(owner, 0) + length
            counts[owner] = counts.get(owner, 0) + 1
        return Reservation(sum(max(0, length - here) for _, length, here in rows), owned, counts)

    @contextmanager
    def creating(self) -> Iterator[None]:
        """A lock for creations over all processes, so that checks remain valid until the upload is on disk."""
        self._folder.mkdir(parents=True, exist_ok=True)
        folder = os.open(self._folder, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        finally:
            os.close(folder)

    def expires_at(self, upload: Upload) -> float:
        return self._touched_at(upload.id) + self._ttl_s

    @contextmanager
    def claim(self, upload: Upload) -> Iterator[BinaryIO]:
        """The part file, locked and positioned at its end. Raises Locked, NotFound (closed or removed)."""
        try:
            file = self._part(upload.id).open("r+b")
        except FileNotFoundError:
            raise _finished(upload.id) from None
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise Locked(
                    "Another request writes to this upload.",
                    headers=retry_after(1),
                    field="upload_id",
                    value=upload.id,
                    remedy="Request the offset in a second, then continue from there.",
                ) from None
            if os.fstat(file.fileno()).st_nlink == 0:  # closed or removed between open and lock
                raise _finished(upload.id)
            file.seek(0, os.SEEK_END)
            yield file

    def path(self, upload: Upload) -> Path:
        """Path of the part file."""
        return self._part(upload.id)

    def became(self, upload: Upload, asset_id: str) -> Upload:
        """Record the asset and delete the part file."""
        return self._close(replace(upload, asset_id=asset_id))

    def refused(self, upload: Upload, error: ImpastoError) -> Upload:
        """Record the error that refused the file, and delete the part file."""
        fault = Fault(error.code, error.message, error.remedy, error.field, error.value)
        return self._close(replace(upload, fault=fault))

    def remove(self, upload: Upload) -> None:
        self._info(upload.id).unlink(missing_ok=True)
        self._part(upload.id).unlink(missing_ok=True)

    def sweep(self) -> None:
        """Delete expired uploads and files that a killed process left."""
        for path in self._folder.glob("*"):
            ours = path.suffix in (".json", ".part")
            with suppress(FileNotFoundError):  # finished or removed during this loop
                touched_at = self._touched_at(path.stem) if ours else path.stat().st_mtime
                if touched_at + self._ttl_s < self._clock():
                    _delete(path)

    def _close(self, upload: Upload) -> Upload:
        self._write(upload)
        self._part(upload.id).unlink(missing_ok=True)
        return upload

    def _write(self, upload: Upload) -> None:
        fresh = self._folder / f"{upload.id}.new"
        with fresh.open("w") as file:
            json.dump(asdict(upload), file)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self._info(upload.id))

    def _touched_at(self, upload_id: str) -> float:
        """Time of the upload's last change, seconds since the epoch."""
        paths = (self._info(upload_id), self._part(upload_id))
        return max((path.stat().st_mtime for path in paths if path.exists()), default=0.0)

    def _part_bytes(self, upload_id: str) -> int:
        with suppress(FileNotFoundError):
            return self._part(upload_id).stat().st_size
        return 0

    def _info(self, upload_id: str) -> Path:
        return self._folder / f"{upload_id}.json"

    def _part(self, upload_id: str) -> Path:
        return self._folder / f"{upload_id}.part"


def _finished(upload_id: str) -> NotFound:
    return NotFound("The upload is finished.", field="upload_id", value=upload_id, remedy="Ask for its state (HEAD).")


def _delete(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink()
