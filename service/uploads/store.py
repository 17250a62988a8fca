"""Unfinished uploads on disk: `<id>.json` says what it is, `<id>.part` holds its bytes; its size is the offset.

Nothing is kept in memory, so that an upload survives the process. A lock on the part file keeps two writers apart,
also over processes.
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
from workers.errors import NotFound
from workers.model import Fault


@dataclass(frozen=True)
class Upload:
    """A resumable upload. When whole, either `asset_id` names the asset that it became, or `fault` says why not."""

    id: str
    owner: str
    filename: str
    metadata: str
    """Upload-Metadata as it came: tus wants it back."""
    length: int
    asset_id: str | None = None
    fault: Fault | None = None

    @property
    def closed(self) -> bool:
        """Whether its bytes have gone on."""
        return self.asset_id is not None or self.fault is not None


class UploadStore:
    """The uploads of one folder.

    Args:
        folder: made when needed.
        ttl_s: an upload that nothing has touched for so long is over.
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
            raise NotFound(
                "There is no such upload.", field="upload_id", value=upload_id, remedy="Begin a new one."
            ) from None
        upload = Upload(**row | {"fault": row["fault"] and Fault(**row["fault"])})
        if self.expires_at(upload) < self._clock():
            raise Gone("The upload has expired.", field="upload_id", value=upload_id, remedy="Begin a new one.")
        return upload

    def offset(self, upload: Upload) -> int:
        """Bytes that are safe here."""
        return upload.length if upload.closed else self._part(upload.id).stat().st_size

    def expires_at(self, upload: Upload) -> float:
        return self._touched_at(upload.id) + self._ttl_s

    @contextmanager
    def claim(self, upload: Upload) -> Iterator[BinaryIO]:
        """The part, for this one writer, positioned at its end. Raises Locked, NotFound (finished or removed)."""
        try:
            file = self._part(upload.id).open("r+b")
        except FileNotFoundError:
            raise NotFound("The upload is finished.", field="upload_id", value=upload.id) from None
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise Locked(
                    "Another request writes to this upload.",
                    headers=retry_after(1),
                    field="upload_id",
                    value=upload.id,
                    remedy="Ask for the offset in a second, then go on from there.",
                ) from None
            file.seek(0, os.SEEK_END)
            yield file

    def path(self, upload: Upload) -> Path:
        """Where the bytes are."""
        return self._part(upload.id)

    def became(self, upload: Upload, asset_id: str) -> Upload:
        """Note the asset; the bytes are not needed here any more."""
        return self._close(replace(upload, asset_id=asset_id))

    def refused(self, upload: Upload, error: ImpastoError) -> Upload:
        """Note why the media were refused."""
        fault = Fault(error.code, error.message, error.remedy, error.field, error.value)
        return self._close(replace(upload, fault=fault))

    def remove(self, upload: Upload) -> None:
        self._info(upload.id).unlink(missing_ok=True)
        self._part(upload.id).unlink(missing_ok=True)

    def sweep(self) -> None:
        """Delete what has expired, and what a killed process has left."""
        for path in self._folder.glob("*"):
            ours = path.suffix in (".json", ".part")
            with suppress(FileNotFoundError):  # finished or removed while we look
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
        """When the upload last moved; both its files live and die together."""
        paths = (self._info(upload_id), self._part(upload_id))
        return max((path.stat().st_mtime for path in paths if path.exists()), default=0.0)

    def _info(self, upload_id: str) -> Path:
        return self._folder / f"{upload_id}.json"

    def _part(self, upload_id: str) -> Path:
        return self._folder / f"{upload_id}.part"


def _delete(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink()
