"""From a file on disk to an asset: quota, the farm's probe, and whether it was known before."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import StorageFull
from service.access.depends import Service
from service.access.keys import Principal
from workers.errors import NotFound, QuotaExceeded
from workers.model import Asset

NO_ROOM = "Try later, or tell the operator to free space."


def adopt(parts: Service, caller: Principal, path: Path, filename: str, sha256: str) -> tuple[Asset, bool]:
    """Keep the file at `path` as an asset of the caller. Returns it, and whether it is new to the caller.

    Raises: BadMedia, StorageFull, QuotaExceeded.
    """
    known = _known(parts, caller, f"ast_{sha256}")
    if not known:
        check_quota(parts, caller, path.stat().st_size)
    return parts.farm.add_asset(path, filename, caller.owner), not known


def _known(parts: Service, caller: Principal, asset_id: str) -> bool:
    try:
        parts.farm.asset(asset_id, caller.owner)
    except NotFound:
        return False
    return True


def check_quota(parts: Service, caller: Principal, size_bytes: int) -> None:
    """Raise QuotaExceeded if `size_bytes` more would be more than the caller may keep."""
    limit = caller.quotas.get("asset_bytes", parts.settings.quota_asset_bytes)
    if limit is not None and size_bytes + parts.farm.keys.usage(caller.owner)["asset_bytes"] > limit:
        raise QuotaExceeded(
            f"Your assets may be {limit} bytes together.",
            field="file",
            value=size_bytes,
            remedy="Delete assets that you no longer need.",
        )


def check_room(parts: Service, size_bytes: int) -> None:
    """Raise StorageFull unless the disk of unfinished uploads has room for `size_bytes` and the reserve."""
    free = shutil.disk_usage(parts.settings.uploads_dir).free
    if free - size_bytes < parts.settings.reserve_bytes:
        raise StorageFull("The disk is nearly full.", field="file", value=size_bytes, remedy=NO_ROOM)


@contextmanager
def disk_faults() -> Iterator[None]:
    """Say StorageFull when the disk is."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise StorageFull("The disk is full.", field="file", remedy=NO_ROOM) from error
        raise
