"""Farm: all that the service and the command line see of assets, jobs and workers.

A Farm ties a store (the truth), blobs and a pool (the muscle) together. Open one with `open_farm`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from workers.model import Asset, Event, Job, JobRequest, Json, Submitted, TaskView

if TYPE_CHECKING:  # they need what is described here
    from workers.fleet import Fleet
    from workers.live.live import Live


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


SCOPES = ("submit", "read", "admin")
"""What a key may do; "admin" includes the others."""


@dataclass(frozen=True)
class ApiKey:
    """A key as operators see it; the secret itself is not kept, only its hash."""

    id: str
    """`key_...`: also the `owner` of what is made with it."""
    name: str
    scopes: frozenset[str]
    """Of SCOPES."""
    quotas: dict[str, int]
    """Name -> bound, as the service understands it ("active_jobs", "asset_bytes", "requests_per_minute") and the
    dispatcher ("running_tasks")."""
    created_at: float
    revoked_at: float | None = None

    def allows(self, scope: str) -> bool:
        return scope in self.scopes or "admin" in self.scopes


class Keys(Protocol):
    """API keys: made, listed, revoked, verified."""

    def create(self, name: str, scopes: Collection[str], quotas: Mapping[str, int] | None = None) -> tuple[ApiKey, str]:
        """A new key and its secret, which is shown this once. Raises BadParameter (unknown scope, bad quota)."""
        ...

    def list(self) -> list[ApiKey]:
        """Every key, oldest first, revoked ones too."""
        ...

    def revoke(self, key_id: str) -> ApiKey:
        """From now on `verify` refuses it. Revoking twice is the same as once. Raises NotFound."""
        ...

    def verify(self, secret: str) -> ApiKey | None:
        """The key of a secret, or None: malformed, unknown or revoked. Takes the same time for right and wrong ones."""
        ...

    def usage(self, key_id: str) -> dict[str, int]:
        """What counts against quotas now: "active_jobs" and "asset_bytes"."""
        ...


@dataclass(frozen=True)
class Delivery:
    """One webhook message of the outbox: written with the job's end, in the same transaction."""

    id: str
    """`msg_...`: the Standard Webhooks message id, the same over all tries."""
    job_id: str
    owner: str
    url: str
    body: Json
    """{"type": "job.succeeded" | "job.failed" | "job.cancelled", "timestamp": ISO 8601, "data": {...}}"""
    created_at: float
    tries: int
    """Tries made so far."""
    state: str = "waiting"
    """"waiting", "delivered" or "dead" (the last try failed)."""
    next_at: float | None = None
    """When it is tried again; None once it is delivered or dead."""
    last_error: str = ""


class Webhooks(Protocol):
    """The outbox. Who sends: `for d in due(): status = post(d); record(d.id, status, error)`."""

    def due(self, limit: int = 20, lease_s: float = 60.0) -> list[Delivery]:
        """Claim messages to send now. One that is not recorded within `lease_s` becomes due again."""
        ...

    def record(self, delivery_id: str, status: int | None, error: str = "") -> Delivery:
        """The outcome of a try: 2xx delivers it; anything else (None: no answer) waits longer each time, then is
        dead. 410 (gone) is dead at once. Raises NotFound."""
        ...

    def of_job(self, job_id: str) -> list[Delivery]: ...


class Farm(Protocol):
    @property
    def keys(self) -> Keys: ...

    @property
    def webhooks(self) -> Webhooks: ...

    @property
    def live(self) -> Live:
        """Live sessions."""
        ...

    @property
    def fleet(self) -> Fleet:
        """Who works where: for operators."""
        ...

    @property
    def worker_id(self) -> str:
        """As the fleet knows this process; empty if it runs nothing."""
        ...

    # -- life
    def start(self) -> None: ...
    def drain(self, timeout_s: float) -> bool:
        """Take no new task, and let those that run end; whether all did within `timeout_s`. Call `stop` then."""
        ...

    def stop(self) -> None:
        """Give back what still runs, and end."""
        ...

    # -- assets
    def add_asset(self, path: Path, filename: str, owner: str = "") -> Asset:
        """Probe and keep the file at `path` (which the caller may delete after). Raises BadMedia, StorageFull."""
        ...

    def asset(self, asset_id: str, owner: str | None = None) -> Asset:
        """The asset. Several owners may hold the same bytes: with `owner`, as that one holds it, else NotFound."""
        ...

    def assets(self, owner: str | None = None, cursor: str | None = None, limit: int = 50) -> Page: ...
    def delete_asset(self, asset_id: str, owner: str | None = None) -> None:
        """Forget it; with `owner`, for that owner only. Raises Conflict while a job (of theirs) that is not final
        uses it."""
        ...

    def asset_file(self, asset_id: str) -> Served: ...
    def asset_frame(self, asset_id: str, index: int, max_side_px: int = 720) -> bytes:
        """Frame `index` (of a shorter video, its last) as uploaded, scaled to fit; JPEG bytes. Raises BadMedia."""
        ...

    # -- jobs
    def submit(
        self,
        request: JobRequest,
        owner: str = "",
        idempotency_key: str = "",
        admit: Callable[[], None] = lambda: None,
    ) -> Submitted:
        """Validate (method, params, inputs exist and fit) and accept durably. Same key and body: the same job.

        Args:
            admit: called before a job is accepted that is new; what it raises (a quota) is raised, and there is no job.

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
    def direct_url(self, served: Served) -> str | None:
        """A signed URL that gives the file past us, good for an hour; None unless the operator wants that."""
        ...

    # -- one frame, now
    def preview(
        self, request: JobRequest, frame: int, max_side_px: int = 640, design: Json | None = None,
        regions_of: str | None = None,
    ) -> bytes:  # fmt: skip
        """Stylise one frame (scaled to fit) with the request's parameters; PNG bytes. For live thumbnails.

        Args:
            design: a design document instead of the request's input of that name.
            regions_of: a job whose artefact "regions" tells where tubes and objects are.
        """
        ...

    # -- operators
    def ready(self) -> dict[str, str]:
        """Part ("store", "blobs", "pool") -> "ok" or what is wrong."""
        ...

    def snapshot(self) -> Json:
        """Queue depth and age, tasks by state, workers, throughput, and under "totals" what this process has counted
        since it began (attempts by outcome, failures by code, frames and busy seconds by method): for metrics."""
        ...
