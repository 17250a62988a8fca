"""Made from `_async` by client/make_sync.py: do not edit."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import httpx

from impasto_client._sync import transfer
from impasto_client._sync.events import follow
from impasto_client._sync.http import Connection
from impasto_client._sync.ops import Ops
from impasto_client._sync.owners import Owners
from impasto_client._sync.projects import Projects
from impasto_client.defaults import DEFAULT_SERVER, FINAL
from impasto_client.errors import NotFound, ServiceUnreachable
from impasto_client.events import ServerEvent
from impasto_client.files import SMALL_BYTES, Progress, asset_id_of, existing, quiet
from impasto_client.models import Asset, Job, JobOptions, Method, Task
from impasto_client.problems import job_failed

if TYPE_CHECKING:
    from typing import Self

    from typing_extensions import Unpack

PLAIN_FILES = frozenset({"result", "poster", "sheet", "preview"})
POLL_INTERVAL_S = 0.2
"""Seconds between requests for the state of a job."""
RETRY_S = 60.0
"""Time for which `watch` and `wait` retry while the service does not answer, seconds."""


class Client:
    """Talks to one service. A context manager; not for several threads at once.

    Answers are the API's JSON objects (`impasto_client.models`, docs/api.md); problems are raised as the classes of
    `impasto_client.errors`, with `code`, `field`, `value` and `remedy`.

    Args:
        server: address without `/v1`, for example "https://impasto.example.org"; for a group,
            ``https://impasto.example.org/groups/grp_...``.
        api_key: sent as a bearer token; empty where the service is open (loopback).
        timeout_s: seconds to connect, and between bytes of an answer.
        transport: HTTP transport, for tests.
        ca_file: PEM file of the certificate authorities to trust; "": SSL_CERT_FILE, else Mozilla's list. Proxies come
            from HTTPS_PROXY, HTTP_PROXY and NO_PROXY, or the system; none is used for an address of this computer.
    """

    def __init__(
        self,
        server: str = DEFAULT_SERVER,
        api_key: str = "",
        timeout_s: float = 30.0,
        transport: httpx.BaseTransport | None = None,
        ca_file: str | Path = "",
    ) -> None:
        self._at = Connection(server, api_key, timeout_s, transport, ca_file)
        self.server = self._at.server
        self.ops = Ops(self._at)
        """Operators' calls: queue, workers, failures. They need an admin key."""
        self.owners = Owners(self._at)
        """Users and groups, audit trail, costs, rules of deletion."""
        self.projects = Projects(self._at)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._at.http.close()

    def me(self) -> dict[str, Any]:
        """Who the key belongs to: user, scopes, groups, quotas and their use."""
        found: dict[str, Any] = self._at.json("GET", "/me")
        return found

    # -- methods

    def methods(self) -> list[Method]:
        """Every method the service offers."""
        return self._at.items("/methods")

    def method(self, name: str) -> Method:
        """One method with the JSON Schema of its parameters, its inputs and examples."""
        found: Method = self._at.json("GET", f"/methods/{name}")
        return found

    # -- assets

    def upload(self, path: str | Path, progress: Progress = quiet) -> Asset:
        """Send a file unless the service has these bytes already; return the asset. Large files are resumable.

        Raises: BadInput (no such file), BadMedia (the file is invalid), QuotaExceeded.
        """
        file = existing(path)
        asset_id = asset_id_of(file)
        try:
            return self.asset(asset_id)
        except NotFound:
            return self._send_file(file, asset_id, progress)

    def _send_file(self, file: Path, asset_id: str, progress: Progress) -> Asset:
        if (size := file.stat().st_size) > SMALL_BYTES:
            last = transfer.upload(self._at.http, "/uploads", file, progress)
            return self.asset(last.headers.get("Impasto-Asset", asset_id))
        sent: Asset = self._at.json("POST", "/assets", files={"file": (file.name, file.read_bytes())})
        progress(size, size)
        return sent

    def asset(self, asset_id: str) -> Asset:
        found: Asset = self._at.json("GET", f"/assets/{asset_id}")
        return found

    def assets(self, most: int = 200) -> list[Asset]:
        """The newest assets, at most `most`."""
        return [item for item in self._at.every("/assets", most)]

    def delete_asset(self, asset_id: str) -> None:
        """Delete an asset. Raises: Conflict while an unfinished job or a project uses it."""
        self._at.send("DELETE", f"/assets/{asset_id}")

    # -- jobs

    def submit(
        self,
        method: str,
        inputs: Mapping[str, str],
        params: Mapping[str, object] | None = None,
        *,
        idempotency_key: str = "",
        **more: Unpack[JobOptions],
    ) -> Job:
        """Submit a job. `inputs`: input name -> asset id. `more`: seed, frames, output, priority, name, labels,
        webhook, on_damage, source.

        Without `idempotency_key` each call creates a job; with one, the same request returns the same job.
        Raises: BadParameter, NotFound (an asset), IdempotencyMismatch, QuotaExceeded.
        """
        body = {"method": method, "inputs": dict(inputs), "params": dict(params or {}), **more}
        headers = {"Idempotency-Key": idempotency_key or uuid.uuid4().hex}
        job: Job = self._at.json("POST", "/jobs", json=body, headers=headers)
        return job

    def estimate(self, request: Mapping[str, object]) -> dict[str, Any]:
        """Wall time, CPU time, memory and disk space of a job with this request (the body of `POST /v1/jobs`)."""
        found: dict[str, Any] = self._at.json("POST", "/estimates", json={"request": dict(request)})
        return found

    def preview(
        self,
        method: str,
        inputs: Mapping[str, str],
        params: Mapping[str, object] | None = None,
        *,
        frame: int = 0,
        max_side_px: int = 640,
        seed: int = 0,
    ) -> bytes:
        """One painted frame, as a PNG."""
        body: dict[str, Any] = {"method": method, "inputs": dict(inputs), "params": dict(params or {})}
        body |= {"frame": frame, "max_side_px": max_side_px, "seed": seed}
        return (self._at.send("POST", "/previews", json=body)).content

    def job(self, job_id: str) -> Job:
        job: Job = self._at.json("GET", f"/jobs/{job_id}")
        return job

    def jobs(self, **filters: object) -> list[Job]:
        """The newest jobs. `filters`: state, method, label ("shot:12"), search, limit, cursor."""
        return self._at.items("/jobs", **filters)

    def newest_jobs(self, most: int, **filters: Any) -> Iterator[Job]:
        """The newest jobs, at most `most`, read page by page."""
        for job in self._at.every("/jobs", most, **filters):
            yield job

    def cancel(self, job_id: str) -> Job:
        return self._act(job_id, "cancel")

    def pause(self, job_id: str) -> Job:
        """Start no further tasks of the job. Running ones finish."""
        return self._act(job_id, "pause")

    def resume(self, job_id: str) -> Job:
        return self._act(job_id, "resume")

    def retry(self, job_id: str) -> Job:
        """Run the failed and cancelled tasks again."""
        return self._act(job_id, "retry")

    def _act(self, job_id: str, verb: str) -> Job:
        job: Job = self._at.json("POST", f"/jobs/{job_id}/{verb}")
        return job

    def tasks(self, job_id: str, state: str | None = None) -> list[Task]:
        """The job's tasks in order, each with its attempts."""
        return [item for item in self._at.every(f"/jobs/{job_id}/tasks", state=state)]

    def requeue(self, task_id: str) -> Task:
        """Run a failed or cancelled task again; return the task."""
        task: Task = self._at.json("POST", f"/tasks/{task_id}/requeue")
        return task

    def delete(self, job_id: str) -> None:
        """Delete a finished job and its files."""
        self._at.send("DELETE", f"/jobs/{job_id}")

    def events(self, job_id: str, after: int = 0) -> Iterator[ServerEvent]:
        """A job's events with seq > `after` until it ends; reconnects as needed."""
        for event in follow(self._at.http, f"/jobs/{job_id}/events", after=after):
            if event is not None:
                yield event
            if (event is None or event.type == "job.state") and (self.job(job_id))["state"] in FINAL:
                return

    def watch(self, job_id: str, poll_s: float = 1.0) -> Iterator[Job]:
        """The job now and after each change, until it ends. Survives restarts of the service."""
        previous: Job | None = None
        for job in self._poll(job_id, poll_s):
            if job != previous:
                previous = job
                yield job

    def wait(self, job_id: str, timeout_s: float = float("inf")) -> Job:
        """Wait until the job has succeeded, and return it.

        Raises: JobFailed (its `job` is the job); TimeoutError, up to 15 s late while the job makes no progress.
        """
        deadline = time.monotonic() + timeout_s
        for job in self._poll(job_id, 1.0):
            if job["state"] == "succeeded":
                return job
            if job["state"] in FINAL:
                raise job_failed(job)
            if time.monotonic() > deadline:
                break
        raise TimeoutError(f"Job {job_id} has not ended after {timeout_s} s.")

    def _poll(self, job_id: str, poll_s: float) -> Iterator[Job]:
        """The job after each event or heartbeat, at most five times a second, up to its end."""
        job, last = self.job(job_id), time.monotonic()
        yield job
        if job["state"] in FINAL:
            return
        for event in follow(self._at.http, f"/jobs/{job_id}/events", poll_s=poll_s):
            urgent = event is None or event.type == "job.state"
            if urgent or time.monotonic() - last > POLL_INTERVAL_S:
                job, last = self._job_with_retries(job_id), time.monotonic()
                yield job
            if job["state"] in FINAL:
                return

    def _job_with_retries(self, job_id: str) -> Job:
        deadline = time.monotonic() + RETRY_S
        while True:
            try:
                return self.job(job_id)
            except ServiceUnreachable:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.5)

    def download(self, job_id: str, path: str | Path, name: str = "result", progress: Progress = quiet) -> Path:
        """Fetch a job's file into `path`, which appears whole or not at all.

        `name`: "result", "poster", "sheet", "preview", or an artefact's name.
        """
        target = Path(path)
        where = f"/jobs/{job_id}/{name}" if name in PLAIN_FILES else f"/jobs/{job_id}/files/{name}"
        transfer.download(self._at.http, where, target, progress)
        return target
