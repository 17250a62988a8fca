"""Farm: all that the service and the command line see of assets, jobs and workers.

A Farm ties a store (the truth), blobs and a pool (the muscle) together. Open one with `open_farm`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from workers.model import Asset, Event, Job, JobRequest, Json, TaskView


@dataclass(frozen=True)
class Page:
    """One page of a listing; `cursor` is None on the last."""

    items: tuple[Any, ...]
    cursor: str | None


@dataclass(frozen=True)
class Served:
    """A file that can be read in ranges."""

    key: str
    size_bytes: int
    media_type: str
    filename: str
    etag: str


class Farm(Protocol):
    # -- life
    def start(self) -> None: ...
    def stop(self) -> None: ...

    # -- assets
    def add_asset(self, path: Path, filename: str, owner: str = "") -> Asset:
        """Probe and keep the file at `path` (which the caller may delete after). Raises BadMedia, StorageFull."""
        ...

    def asset(self, asset_id: str) -> Asset: ...
    def assets(self, owner: str | None = None, cursor: str | None = None, limit: int = 50) -> Page: ...
    def delete_asset(self, asset_id: str) -> None:
        """Raises Conflict while a job that is not final uses it."""
        ...

    def asset_file(self, asset_id: str) -> Served: ...

    # -- jobs
    def submit(self, request: JobRequest, owner: str = "", idempotency_key: str = "") -> Job:
        """Validate (method, params, inputs exist and fit) and accept durably. Same key and body: the same job.

        Raises BadParameter, NotFound (an asset), IdempotencyMismatch, StorageFull.
        """
        ...

    def job(self, job_id: str) -> Job: ...
    def jobs(
        self,
        state: str | None = None,
        method: str | None = None,
        owner: str | None = None,
        label: tuple[str, str] | None = None,
        cursor: str | None = None,
        limit: int = 50,
    ) -> Page:
        """Newest first."""
        ...

    def cancel(self, job_id: str) -> Job: ...
    def pause(self, job_id: str) -> Job: ...
    def resume(self, job_id: str) -> Job: ...
    def retry(self, job_id: str) -> Job:
        """Queue again only what failed or was cancelled. Raises Conflict unless the job failed or was cancelled."""
        ...

    def delete(self, job_id: str) -> None:
        """Forget the job and its blobs. Raises Conflict unless it is final."""
        ...

    def tasks(self, job_id: str, state: str | None = None, cursor: str | None = None, limit: int = 100) -> Page:
        """TaskView items in plan order."""
        ...

    def task(self, task_id: str) -> TaskView: ...
    def task_log(self, task_id: str) -> str: ...
    def requeue(self, task_id: str) -> TaskView:
        """Run a failed or cancelled task again."""
        ...

    def events(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[list[Event], bool]:
        """Events with seq > `after`, and whether some of those asked for are gone (history is kept to a bound)."""
        ...

    def wait(self, job_id: str, after: int, timeout_s: float) -> bool:
        """Block until the job has an event with seq > `after`; False on time-out."""
        ...

    # -- files
    def file(self, job_id: str, name: str) -> Served:
        """ "result", "poster" (JPEG), "sheet" (contact sheet, JPEG), "preview" (newest frame, JPEG), or an artefact's
        name. Raises NotFound, or Conflict while it is not there yet."""
        ...

    def read(self, served: Served, start: int = 0, stop: int | None = None) -> Iterator[bytes]: ...
    def local(self, served: Served) -> AbstractContextManager[Path]: ...

    # -- one frame, now
    def preview(self, request: JobRequest, frame: int, max_side_px: int = 640) -> bytes:
        """Stylise one frame (scaled to fit) with the request's parameters; PNG bytes. For live thumbnails."""
        ...

    # -- operators
    def ready(self) -> dict[str, str]:
        """Part ("store", "blobs", "pool") -> "ok" or what is wrong."""
        ...

    def snapshot(self) -> Json:
        """Queue depth and age, tasks by state, workers, throughput: for metrics and the ops page."""
        ...
