"""Garbage collection: removes unneeded blobs and leftovers of crashes. It runs in a separate thread, because a
remote blob store is slow."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby

from pipeline.errors import StorageError, StorageFull
from workers.blobs.base import Blobs
from workers.contract.record import asset_key
from workers.store import Store
from workers.store.projects import Retention

log = logging.getLogger(__name__)

_JOBS, _ASSETS = "jobs/", "assets/"
_BACK_OFF_S = 5.0


@dataclass(frozen=True)
class Removed:
    """Numbers of things that a sweep has removed."""

    unfinished: int = 0
    """Unfinished files and uploads of crashed processes."""
    jobs: int = 0
    """Blobs of jobs that have ended or were deleted."""
    assets: int = 0
    """Bytes that belong to no asset."""
    projects: int = 0
    """Projects whose time for undoing the deletion is over."""
    versions: int = 0
    """Old versions of projects that are not kept."""
    aged: int = 0
    """Jobs that have reached the age of a rule."""
    records: int = 0
    """Entries of the audit trail, costs and browsers' sessions that have reached their age."""


class GarbageCollector:
    """Removes what no job needs. Thread-safe.

    Args:
        every_s: interval of full sweeps, seconds; the first is soon after the start.
        may_sweep: whether this process, of all that share the store, is the one that sweeps now.
        undo_s: how long a deleted project can be restored.
        retention: which versions of projects stay.
        reuse_s: how long task results are kept for later jobs of a project, while there is space.
        records_s: how long the audit trail and costs of jobs are kept.

    Attributes:
        apply_rules: deletes the jobs that have reached the age of a rule, before each sweep; returns their ids.
    """

    def __init__(
        self, store: Store, blobs: Blobs, every_s: float, may_sweep: Callable[[], bool],
        undo_s: float = 30 * 86400.0, retention: Retention = Retention(), reuse_s: float = 86400.0,
        records_s: float = 366 * 86400.0,
    ) -> None:  # fmt: skip
        self._store, self._blobs = store, blobs
        self._undo_s, self._retention, self._reuse_s = undo_s, retention, reuse_s
        self._every_s, self._may_sweep, self._records_s = every_s, may_sweep, records_s
        self.apply_rules: Callable[[], list[str]] = list
        self._jobs: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="impasto-collector", daemon=True)
        self._stopping = threading.Event()

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()
        self._jobs.put(None)
        if self._thread.is_alive():
            self._thread.join(5.0)

    def later(self, job_id: str) -> None:
        """Delete what the job no longer needs, soon and in the background."""
        self._jobs.put(job_id)

    def job(self, job_id: str) -> int:
        """Delete the blobs that only the job's tasks needed, or all its blobs if the job was deleted, except those that
        later jobs may reuse; returns their number. The size of its results becomes a part of its cost."""
        kept = self._store.jobs.blob_keys(job_id)
        if kept:
            self._store.costs.stored(job_id, sum(self._blobs.size(key) or 0 for key in kept))
        return self._job(job_id, self._reusable() if self._store.reuse.is_shared(job_id) else set(), kept)

    def _job(self, job_id: str, reusable: set[str], kept: set[str]) -> int:
        keys = self._blobs.keys(f"{_JOBS}{job_id}/")
        return self._delete(key for key in keys if key not in kept and key not in reusable)

    def _reusable(self) -> set[str]:
        """Blobs of tasks that are kept for reuse; if the disk is full, only what unfinished jobs use."""
        try:
            self._blobs.check_free_space()
        except StorageFull:
            return self._store.reuse.kept_keys(0.0)
        return self._store.reuse.kept_keys(self._reuse_s)

    def sweep(self) -> Removed:
        """Remove everything that is not needed. Blobs that are being written are safe, because their job is not final,
        or their asset is stored again."""
        aged = len(self.apply_rules())
        unfinished = self._blobs.sweep()
        reusable = self._reusable()
        over = (job_id for job_id in self._job_ids() if self._is_over(job_id))
        jobs = sum(self._job(job_id, reusable, self._store.jobs.blob_keys(job_id)) for job_id in over)
        assets = sum(self._asset(key) for key in list(self._blobs.keys(_ASSETS)))
        projects, records = self._store.projects.purge(self._undo_s), self._prune()
        return Removed(unfinished, jobs, assets, projects, self._thin(), aged, records)

    def _prune(self) -> int:
        ages = (self._store.audit.prune(self._records_s), self._store.costs.prune(self._records_s))
        return sum(ages) + self._store.keys.forget_sessions()

    def _thin(self) -> int:
        total = 0
        while thinned := self._store.projects.thin(self._retention):
            total += thinned
        return total

    # -- the thread

    def _run(self) -> None:
        due = time.monotonic() + min(_BACK_OFF_S, self._every_s)
        while not self._stopping.is_set():
            try:
                job_id = self._jobs.get(timeout=max(0.0, due - time.monotonic()))
            except queue.Empty:
                due = time.monotonic() + (self._every_s if self._try(self._sweep_if_allowed) else _BACK_OFF_S)
                continue
            if job_id is not None and not self._try(lambda job_id=job_id: self.job(job_id)):  # type: ignore[misc]
                self._jobs.put(job_id)
                self._stopping.wait(_BACK_OFF_S)

    def _try(self, act: Callable[[], object]) -> bool:
        try:
            act()
        except StorageError as error:
            log.warning("clearing up waits: %s", error)
            return False
        except Exception:
            log.exception("clearing up failed")
        return True

    def _sweep_if_allowed(self) -> None:
        if self._may_sweep() and (swept := self.sweep()) != Removed():
            log.info("swept %s", swept)

    # -- deletion

    def _delete(self, keys: Iterator[str]) -> int:
        gone = list(keys)
        if gone:
            self._blobs.delete_all(gone)
        return len(gone)

    def _job_ids(self) -> Iterator[str]:
        found = (key.split("/")[1] for key in self._blobs.keys(_JOBS))
        return (job_id for job_id, _ in groupby(found))

    def _is_over(self, job_id: str) -> bool:
        """Failed and cancelled jobs may be retried, so their blobs are kept."""
        return self._store.jobs.succeeded(job_id) or not self._store.jobs.exists(job_id)

    def _asset(self, key: str) -> bool:
        """Delete bytes that belong to no asset. An asset that is added at the same time stores its bytes again."""
        asset_id, gone = f"ast_{key.removeprefix(_ASSETS)}", []
        assert asset_key(asset_id) == key

        def forget() -> None:
            self._blobs.delete(key)
            gone.append(key)

        if not self._store.assets.knows(asset_id):
            self._store.assets.unless_known(asset_id, forget)
        return bool(gone)
