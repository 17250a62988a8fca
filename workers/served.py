"""Files as they are handed out: a name that says what it is, a media type, and a tag (blobs never change)."""

from __future__ import annotations

import hashlib
import mimetypes
from pathlib import PurePosixPath

from workers.farm import Served
from workers.model import Asset, Job
from workers.orders import asset_key
from workers.store.records import Row

_SUFFIXES = {"video/mp4": ".mp4", "video/webm": ".webm", "application/zip": ".zip", "image/jpeg": ".jpg"}


def served_asset(asset: Asset) -> Served:
    return Served(asset_key(asset.id), asset.size_bytes, asset.media_type, asset.filename, asset.sha256)


def served_file(job: Job, row: Row, size_bytes: int) -> Served:
    """A job's file from its row: `my-cat.mp4` for the result of the job "my cat", `poster.jpg`, `labels.zip`."""
    etag = hashlib.sha256(row["key"].encode()).hexdigest()[:32]
    return Served(row["key"], size_bytes, row["media_type"], _filename(job, row), etag)


def _filename(job: Job, row: Row) -> str:
    name, media_type = str(row["name"]), str(row["media_type"])
    if PurePosixPath(name).suffix:
        return name
    suffix = _SUFFIXES.get(media_type) or mimetypes.guess_extension(media_type) or ""
    if name == "result":
        words = "".join(letter if letter.isalnum() else " " for letter in job.request.name).split()
        name = "-".join(words)[:80] or f"impasto-{job.request.method}"
    return name + suffix
