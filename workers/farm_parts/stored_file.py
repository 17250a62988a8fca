"""Files that the farm serves: a blob with a file name, a media type and an entity tag (blobs never change)."""

from __future__ import annotations

import hashlib
import mimetypes
from dataclasses import dataclass
from pathlib import PurePosixPath

from workers.contract.record import Asset, Job, asset_key
from workers.store.records import Row

_SUFFIXES = {"video/mp4": ".mp4", "video/webm": ".webm", "application/zip": ".zip", "image/jpeg": ".jpg"}


@dataclass(frozen=True)
class StoredFile:
    """A file that can be read in byte ranges."""

    key: str
    """Blob key."""
    size_bytes: int
    media_type: str
    filename: str
    etag: str


def asset_file(asset: Asset) -> StoredFile:
    """The bytes of an asset as they were uploaded."""
    return StoredFile(asset_key(asset.id), asset.size_bytes, asset.media_type, asset.filename, asset.sha256)


def job_file(job: Job, row: Row, size_bytes: int) -> StoredFile:
    """A job's file: `my-cat.mp4` for the result of the job "my cat", `poster.jpg`, `labels.zip`.

    Args:
        row: of the table `files`.
    """
    etag = hashlib.sha256(row["key"].encode()).hexdigest()[:32]
    return StoredFile(row["key"], size_bytes, row["media_type"], _filename(job, row), etag)


def _filename(job: Job, row: Row) -> str:
    name, media_type = str(row["name"]), str(row["media_type"])
    if PurePosixPath(name).suffix:
        return name
    suffix = _SUFFIXES.get(media_type) or mimetypes.guess_extension(media_type) or ""
    if name == "result":
        words = "".join(letter if letter.isalnum() else " " for letter in job.request.name).split()
        name = "-".join(words)[:80] or f"impasto-{job.request.method}"
    return name + suffix
