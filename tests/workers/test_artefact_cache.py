"""The artefact cache is faster where possible and never returns other bytes than the store."""

from __future__ import annotations

import io
from pathlib import Path

from workers.blobs.disk import DiskBlobs
from workers.pools.artefact_cache import MOST_BYTES, ArtefactCache, SharedArtefacts


def test_a_cached_artefact_is_not_fetched_from_the_store(tmp_path: Path) -> None:
    store = DiskBlobs(tmp_path)
    cache = ArtefactCache(store)
    cache.begin({"jobs/a.npz": lambda: b"quick"}, keep=False)
    assert cache.get("jobs/a.npz") == b"quick"
    assert cache.end() == {}
    store.put("jobs/a.npz", b"store")
    assert cache.get("jobs/a.npz") == b"store", "the next attempt was given nothing"


def test_a_lost_cached_artefact_is_fetched_from_the_store(tmp_path: Path) -> None:
    store = DiskBlobs(tmp_path)
    store.put("jobs/a.npz", b"store")
    cache = ArtefactCache(store)
    cache.begin({"jobs/a.npz": lambda: None}, keep=False)
    assert cache.get("jobs/a.npz") == b"store"


def test_artefacts_with_waiting_consumers_are_cached_and_stored(tmp_path: Path) -> None:
    store = DiskBlobs(tmp_path)
    cache = ArtefactCache(store)
    cache.begin({}, keep=True)
    cache.put("jobs/a.npz", io.BytesIO(b"state"))
    cache.put("jobs/b.npz", lambda file: file.write(b"more"))
    cache.put("jobs/segment", b"frames")
    cache.put("jobs/large.npz", bytes(MOST_BYTES + 1))
    assert cache.end() == {"jobs/a.npz": b"state", "jobs/b.npz": b"more"}
    assert store.get("jobs/a.npz") == b"state"
    assert store.size("jobs/large.npz") == MOST_BYTES + 1
    cache.begin({}, keep=False)
    cache.put("jobs/c.npz", b"last of its chain")
    assert cache.end() == {}


def test_shared_artefacts_are_bounded_by_bytes_and_keep_the_newest() -> None:
    handed = SharedArtefacts(10)
    handed.add({"a": ("ref-a", 4), "b": ("ref-b", 4)})
    handed.add({"c": ("ref-c", 5)})
    assert handed.of(["a", "b", "c", "d"]) == {"b": "ref-b", "c": "ref-c"}
    handed.add({"d": ("ref-d", 11)})
    assert handed.of(["a", "b", "c", "d"]) == {}
