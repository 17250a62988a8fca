"""Turning an uploaded file into an asset: quota, disk space, probe."""

from __future__ import annotations

import errno
import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import StorageFull
from service.access.keys import Principal
from service.assets.upload_store import UploadStore
from service.context.depends import ServiceContext
from workers.contract.record import Asset
from workers.errors import NotFound, QuotaExceeded

STORAGE_FULL_REMEDY = "Try again later, or ask the operator to free space."


def adopt(context: ServiceContext, caller: Principal, path: Path, filename: str, sha256: str) -> tuple[Asset, bool]:
    """Store the file at `path` as an asset of the caller. Returns it, and whether the caller did not have it before.

    Raises: BadMedia, StorageFull, QuotaExceeded.
    """
    known = _known(context, caller, f"ast_{sha256}")
    if not known:
        open_uploads = UploadStore(context.settings.uploads_dir, context.settings.upload_ttl_s).reserved()
        check_quota(context, caller, path.stat().st_size + open_uploads.owned_bytes.get(caller.owner, 0))
    return context.farm.assets.add(path, filename, caller.owner), not known


def adopt_made(context: ServiceContext, caller: Principal, path: Path) -> Asset:
    """Store a file that the service has made as an asset of the caller. Raises like `adopt`."""
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return adopt(context, caller, path, path.name, sha256)[0]


def _known(context: ServiceContext, caller: Principal, asset_id: str) -> bool:
    try:
        context.farm.assets.get(asset_id, caller.owner)
    except NotFound:
        return False
    return True


def check_quota(context: ServiceContext, caller: Principal, size_bytes: int) -> None:
    """Raise QuotaExceeded if `size_bytes` more would exceed the caller's quota of stored bytes."""
    limit = caller.quotas.get("asset_bytes", context.settings.quota_asset_bytes)
    if limit is not None and size_bytes + context.farm.keys.usage(caller.owner)["asset_bytes"] > limit:
        raise QuotaExceeded(
            f"Your assets and unfinished uploads may have {limit} bytes together.",
            field="file",
            value=size_bytes,
            remedy="Delete assets that you no longer need.",
        )


def check_free_space(context: ServiceContext, size_bytes: int) -> None:
    """Raise StorageFull unless the disk of uploads has `size_bytes` free beyond its reserve."""
    free = shutil.disk_usage(context.settings.uploads_dir).free
    if free - size_bytes < context.settings.reserve_bytes:
        raise StorageFull("The disk is nearly full.", field="file", value=size_bytes, remedy=STORAGE_FULL_REMEDY)


@contextmanager
def disk_faults() -> Iterator[None]:
    """Turn ENOSPC and EDQUOT into StorageFull."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise StorageFull("The disk is full.", field="file", remedy=STORAGE_FULL_REMEDY) from error
        raise


def upload_folder(context: ServiceContext) -> Path:
    """The folder of uploads in progress. Raises StorageFull."""
    with disk_faults():
        context.settings.uploads_dir.mkdir(parents=True, exist_ok=True)
    check_free_space(context, 0)
    return context.settings.uploads_dir
