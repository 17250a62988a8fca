"""`farm.assets`: uploaded files, probed and stored under the hash of their bytes."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Collection, Iterable
from pathlib import Path

from pipeline.video.media import Limits, MediaInfo
from workers.blobs.base import Blobs
from workers.blobs.verified import is_intact
from workers.contract.record import ANY_OWNER, AnyOwner, Asset, Page, asset_key
from workers.errors import NotFound
from workers.execution.lru_cache import LruCache
from workers.execution.source_frames import SourceFrames
from workers.farm_parts.stored_file import StoredFile, asset_file
from workers.operator_views import Violation
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
            if not self._is_stored(key):
                self._blobs.put(key, path)
            if kept := self._store.assets.add(asset, lambda: self._blobs.size(key) is not None):
                return kept

    def _is_stored(self, key: str) -> bool:
        """Whether the undamaged bytes are stored; else an upload stores them."""
        try:
            return is_intact(key, self._blobs.read(key))
        except KeyError:
            return False

    def damage(self, cursor: str | None = None, most_bytes: int = 1 << 30) -> tuple[list[Violation], str | None]:
        """Assets whose stored bytes are missing or have changed, and where to continue; None: all are compared.

        Args:
            most_bytes: about so many bytes are read.
        """
        found: list[Violation] = []
        while most_bytes > 0:
            page = self._store.assets.page(ANY_OWNER, cursor, 1)
            for asset in page.items:
                most_bytes -= max(asset.size_bytes, 1)
                if not self._is_stored(asset_key(asset.id)):
                    there = self._blobs.size(asset_key(asset.id)) is not None
                    message = "Its bytes have changed." if there else "Its bytes are missing."
                    remedy = "Upload the file again: that replaces the bytes. Check the disk."
                    found.append(Violation("damaged-asset", asset.id, message, remedy))
            if (cursor := page.cursor) is None:
                return found, None
        return found, cursor

    def get(self, asset_id: str, owner: str | AnyOwner) -> Asset:
        """The asset with the name and time of `owner`: several owners may have the same bytes. Raises NotFound."""
        return self._store.assets.get(asset_id, owner)

    def owned(self, asset_ids: Iterable[str], owner: str) -> dict[str, Asset]:
        """id -> asset, for those of the assets that the owner has."""
        return self._store.assets.owned(asset_ids, owner)

    def check_free_space(self, size_bytes: int) -> None:
        """Raise StorageFull unless as much is free beyond the reserve."""
        self._blobs.check_free_space(size_bytes)

    def page(self, owner: str | AnyOwner, cursor: str | None = None, limit: int = 50) -> Page:
        """`Asset` items, newest first."""
        return self._store.assets.page(owner, cursor, limit)

    def owners(self, owners: Collection[str]) -> set[str]:
        """Those of the owners who have an asset."""
        return self._store.assets.owners(owners)

    def delete(self, asset_id: str, owner: str | AnyOwner) -> None:
        """Delete that owner's entry, and the bytes with the last entry.

        Raises:
            Conflict: a job that is not final (of that owner) uses the asset.
        """
        if self._store.assets.remove(asset_id, owner):
            self._store.assets.unless_known(asset_id, lambda: self._blobs.delete(asset_key(asset_id)))

    def file(self, asset_id: str, owner: str | AnyOwner) -> StoredFile:
        """The uploaded bytes, under the file name that `owner` gave them. Raises NotFound."""
        return asset_file(self.get(asset_id, owner))

    def frame(self, asset_id: str, owner: str | AnyOwner, index: int, max_side_px: int = 720) -> bytes:
        """Frame `index` as uploaded (the last frame of a shorter video), scaled to fit; JPEG bytes.

        Raises:
            BadMedia: the frame cannot be decoded.
            NotFound: the owner has no such asset.
        """
        asset = self.get(asset_id, owner)
        try:
            return self._images.get(
                (asset_id, index, max_side_px), lambda: self._frames.jpeg(asset, index, max_side_px)
            )
        except KeyError:
            raise NotFound("The asset has been deleted.", field="asset_id", value=asset_id) from None


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
