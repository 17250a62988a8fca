"""`farm.assets`: uploaded files, probed and stored under the hash of their bytes."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Collection
from pathlib import Path

from pipeline.video.media import Limits, MediaInfo
from workers.blobs.base import Blobs
from workers.errors import NotFound
from workers.execution.lru_cache import LruCache
from workers.execution.source_frames import SourceFrames
from workers.farm_parts.stored_file import StoredFile, asset_file
from workers.model import Asset, Page, asset_key
from workers.store import Store

Probe = Callable[[Path, Limits], MediaInfo]
"""Reads the facts of a media file. Raises BadMedia."""


class FarmAssets:
    """
    Args:
        probe: examines a new file.
        limits: how large an asset may be.
        images: cache of encoded frames, shared with the job previews.
    """

    def __init__(self, store: Store, blobs: Blobs, probe: Probe, limits: Limits, images: LruCache[bytes]) -> None:
        self._store, self._blobs = store, blobs
        self._probe, self._limits = probe, limits
        self._images = images
        self._frames = SourceFrames(blobs)

    def close(self) -> None:
        self._frames.close()

    def add(self, path: Path, filename: str, owner: str = "", known: MediaInfo | None = None) -> Asset:
        """Probe and store the file at `path`, which the caller may delete afterwards. Raises BadMedia, StorageFull.

        Args:
            known: what a probe with the default limits has found; used if they are the limits of this farm.
        """
        self._blobs.check_free_space(path.stat().st_size)
        info = known if known is not None and self._limits == Limits() else self._probe(path, self._limits)
        sha256 = _sha256(path)
        asset = Asset(
            id=f"ast_{sha256}",
            sha256=sha256,
            size_bytes=path.stat().st_size,
            filename=filename,
            media_type=info.media_type,
            kind=info.kind,
            info=info.as_json(),
            created_at=time.time(),
            owner=owner,
        )
        return self._store_bytes(asset, path)

    def _store_bytes(self, asset: Asset, path: Path) -> Asset:
        key = asset_key(asset.id)
        while True:  # a concurrent deletion may remove the bytes before the row is written
            if self._blobs.size(key) is None:
                self._blobs.put(key, path)
            if kept := self._store.assets.add(asset, lambda: self._blobs.size(key) is not None):
                return kept

    def get(self, asset_id: str, owner: str | None = None) -> Asset:
        """The asset. Several owners may have the same bytes: with `owner`, that owner's name and time, or NotFound."""
        return self._store.assets.get(asset_id, owner)

    def page(self, owner: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        """`Asset` items, newest first."""
        return self._store.assets.page(owner, cursor, limit)

    def owners(self, owners: Collection[str]) -> set[str]:
        """Those of the owners who have an asset."""
        return self._store.assets.owners(owners)

    def delete(self, asset_id: str, owner: str | None = None) -> None:
        """Delete the asset, or with `owner` only that owner's entry.

        Raises:
            Conflict: a job that is not final (of that owner) uses the asset.
        """
        if self._store.assets.remove(asset_id, owner):
            self._store.assets.unless_known(asset_id, lambda: self._blobs.delete(asset_key(asset_id)))

    def file(self, asset_id: str, owner: str | None = None) -> StoredFile:
        """The uploaded bytes, under the file name that `owner` (None: the first owner) gave them."""
        return asset_file(self.get(asset_id, owner))

    def frame(self, asset_id: str, index: int, max_side_px: int = 720) -> bytes:
        """Frame `index` as uploaded (the last frame of a shorter video), scaled to fit; JPEG bytes.

        Raises:
            BadMedia: the frame cannot be decoded.
            NotFound: the asset does not exist.
        """
        asset = self.get(asset_id)
        try:
            return self._images.get(
                (asset_id, index, max_side_px), lambda: self._frames.jpeg(asset, index, max_side_px)
            )
        except KeyError:
            raise NotFound("The asset has been deleted.", field="asset_id", value=asset_id) from None


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
