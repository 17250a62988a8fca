"""From a file on disk to an asset: quota, the farm's probe, and whether it was known before."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import StorageFull
from service.access.depends import Service
from service.access.keys import Principal
from workers.errors import NotFound, QuotaExceeded
from workers.model import Asset


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
        return caller.sees(parts.farm.asset(asset_id).owner)
    except NotFound:
        return False


def check_quota(parts: Service, caller: Principal, size_bytes: int) -> None:
    """Raise QuotaExceeded if `size_bytes` more would be more than the caller may keep."""
    limit = caller.quotas.get("asset_bytes", parts.settings.asset_bytes)
    if limit is not None and size_bytes + parts.farm.keys.usage(caller.owner)["asset_bytes"] > limit:
        raise QuotaExceeded(
            f"Your assets may be {limit} bytes together.",
            field="file",
            value=size_bytes,
            remedy="Delete assets that you no longer need.",
        )


@contextmanager
def disk_faults() -> Iterator[None]:
    """Say StorageFull when the disk is."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise StorageFull("The disk is full.", remedy="Try later, or tell the operator to free space.") from error
        raise
