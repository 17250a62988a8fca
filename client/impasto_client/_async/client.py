"""A client of the public API."""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import httpx

from impasto_client._async import transfer
from impasto_client._async.events import follow
from impasto_client._async.http import AsyncConnection
from impasto_client._async.ops import AsyncOps
from impasto_client._async.owners import AsyncOwners
from impasto_client._async.projects import AsyncProjects
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


class AsyncClient:
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
        transport: httpx.AsyncBaseTransport | None = None,
        ca_file: str | Path = "",
    ) -> None:
        self._at = AsyncConnection(server, api_key, timeout_s, transport, ca_file)
        self.server = self._at.server
        self.ops = AsyncOps(self._at)
        """Operators' calls: queue, workers, failures. They need an admin key."""
        self.owners = AsyncOwners(self._at)
        """Users and groups, audit trail, costs, rules of deletion."""
        self.projects = AsyncProjects(self._at)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        await self._at.http.aclose()

    async def me(self) -> dict[str, Any]:
        """Who the key belongs to: user, scopes, groups, quotas and their use."""
        found: dict[str, Any] = await self._at.json("GET", "/me")
        return found

    # -- methods

    async def methods(self) -> list[Method]:
        """Every method the service offers."""
        return await self._at.items("/methods")

    async def method(self, name: str) -> Method:
        """One method with the JSON Schema of its parameters, its inputs and examples."""
        found: Method = await self._at.json("GET", f"/methods/{name}")
        return found

    # -- assets

    async def upload(self, path: str | Path, progress: Progress = quiet) -> Asset:
        """Send a file unless the service has these bytes already; return the asset. Large files are resumable.

        Raises: BadInput (no such file), BadMedia (the file is invalid), QuotaExceeded.
        """
        file = existing(path)
        asset_id = await asyncio.to_thread(asset_id_of, file)
        try:
            return await self.asset(asset_id)
        except NotFound:
            return await self._send_file(file, asset_id, progress)

    async def _send_file(self, file: Path, asset_id: str, progress: Progress) -> Asset:
        if (size := file.stat().st_size) > SMALL_BYTES:
            last = await transfer.upload(self._at.http, "/uploads", file, progress)
            return await self.asset(last.headers.get("Impasto-Asset", asset_id))
        sent: Asset = await self._at.json("POST", "/assets", files={"file": (file.name, file.read_bytes())})
        progress(size, size)
        return sent

    async def asset(self, asset_id: str) -> Asset:
        found: Asset = await self._at.json("GET", f"/assets/{asset_id}")
        return found

    async def assets(self, most: int = 200) -> list[Asset]:
        """The newest assets, at most `most`."""
        return [item async for item in self._at.every("/assets", most)]

    async def delete_asset(self, asset_id: str) -> None:
        """Delete an asset. Raises: Conflict while an unfinished job or a project uses it."""
        await self._at.send("DELETE", f"/assets/{asset_id}")

    # -- jobs

    async def submit(
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
        job: Job = await self._at.json("POST", "/jobs", json=body, headers=headers)
        return job

    async def estimate(self, request: Mapping[str, object]) -> dict[str, Any]:
        """Wall time, CPU time, memory and disk space of a job with this request (the body of `POST /v1/jobs`)."""
        found: dict[str, Any] = await self._at.json("POST", "/estimates", json={"request": dict(request)})
        return found

    async def preview(
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
        return (await self._at.send("POST", "/previews", json=body)).content

    async def job(self, job_id: str) -> Job:
        job: Job = await self._at.json("GET", f"/jobs/{job_id}")
        return job

    async def jobs(self, **filters: object) -> list[Job]:
        """The newest jobs. `filters`: state, method, label ("shot:12"), search, limit, cursor."""
        return await self._at.items("/jobs", **filters)

    async def newest_jobs(self, most: int, **filters: Any) -> AsyncIterator[Job]:
        """The newest jobs, at most `most`, read page by page."""
        async for job in self._at.every("/jobs", most, **filters):
            yield job

    async def cancel(self, job_id: str) -> Job:
        return await self._act(job_id, "cancel")

    async def pause(self, job_id: str) -> Job:
        """Start no further tasks of the job. Running ones finish."""
        return await self._act(job_id, "pause")

    async def resume(self, job_id: str) -> Job:
        return await self._act(job_id, "resume")

    async def retry(self, job_id: str) -> Job:
        """Run the failed and cancelled tasks again."""
        return await self._act(job_id, "retry")

    async def _act(self, job_id: str, verb: str) -> Job:
        job: Job = await self._at.json("POST", f"/jobs/{job_id}/{verb}")
        return job

    async def tasks(self, job_id: str, state: str | None = None) -> list[Task]:
        """The job's tasks in order, each with its attempts."""
        return [item async for item in self._at.every(f"/jobs/{job_id}/tasks", state=state)]

    async def requeue(self, task_id: str) -> Task:
        """Run a failed or cancelled task again; return the task."""
        task: Task = await self._at.json("POST", f"/tasks/{task_id}/requeue")
        return task

    async def delete(self, job_id: str) -> None:
        """Delete a finished job and its files."""
        await self._at.send("DELETE", f"/jobs/{job_id}")

    async def events(self, job_id: str, after: int = 0) -> AsyncIterator[ServerEvent]:
        """A job's events with seq > `after` until it ends; reconnects as needed."""
        async for event in follow(self._at.http, f"/jobs/{job_id}/events", after=after):
            if event is not None:
                yield event
            if (event is None or event.type == "job.state") and (await self.job(job_id))["state"] in FINAL:
                return

    async def watch(self, job_id: str, poll_s: float = 1.0) -> AsyncIterator[Job]:
        """The job now and after each change, until it ends. Survives restarts of the service."""
        previous: Job | None = None
        async for job in self._poll(job_id, poll_s):
            if job != previous:
                previous = job
                yield job

    async def wait(self, job_id: str, timeout_s: float = float("inf")) -> Job:
        """Wait until the job has succeeded, and return it.

        Raises: JobFailed (its `job` is the job); TimeoutError, up to 15 s late while the job makes no progress.
        """
        deadline = time.monotonic() + timeout_s
        async for job in self._poll(job_id, 1.0):
            if job["state"] == "succeeded":
                return job
            if job["state"] in FINAL:
                raise job_failed(job)
            if time.monotonic() > deadline:
                break
        raise TimeoutError(f"Job {job_id} has not ended after {timeout_s} s.")

    async def _poll(self, job_id: str, poll_s: float) -> AsyncIterator[Job]:
        """The job after each event or heartbeat, at most five times a second, up to its end."""
        job, last = await self.job(job_id), time.monotonic()
        yield job
        if job["state"] in FINAL:
            return
        async for event in follow(self._at.http, f"/jobs/{job_id}/events", poll_s=poll_s):
            urgent = event is None or event.type == "job.state"
            if urgent or time.monotonic() - last > POLL_INTERVAL_S:
                job, last = await self._job_with_retries(job_id), time.monotonic()
                yield job
            if job["state"] in FINAL:
                return

    async def _job_with_retries(self, job_id: str) -> Job:
        deadline = time.monotonic() + RETRY_S
        while True:
            try:
                return await self.job(job_id)
            except ServiceUnreachable:
                if time.monotonic() > deadline:
                    raise
                await asyncio.sleep(0.5)

    async def download(self, job_id: str, path: str | Path, name: str = "result", progress: Progress = quiet) -> Path:
        """Fetch a job's file into `path`, which appears whole or not at all.

        `name`: "result", "poster", "sheet", "preview", or an artefact's name.
        """
        target = Path(path)
        where = f"/jobs/{job_id}/{name}" if name in PLAIN_FILES else f"/jobs/{job_id}/files/{name}"
        await transfer.download(self._at.http, where, target, progress)
        return target
