"""A small synchronous client of the public API.

    with Client("http://127.0.0.1:8420") as impasto:
        job = impasto.submit("abstraction", {"video": impasto.upload("clip.mp4")["id"]})
        impasto.wait(job["id"])
        impasto.download(job["id"], "cartoon.mp4")

Answers are the API's JSON objects as dicts (docs/api.md); problems are raised as the classes of `pipeline.errors`,
`workers.errors` and `impasto.problems`, with `code`, `field`, `value` and `remedy`.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx

from impasto import transfer
from impasto.events import ServerEvent, follow
from impasto.ops import Ops
from impasto.problems import ServiceUnreachable, error_of, job_failed
from impasto.settings import DEFAULT_SERVER
from pipeline.errors import BadInput
from workers.contract.request import Json
from workers.errors import NotFound

FINAL = frozenset({"succeeded", "failed", "cancelled"})
SMALL_BYTES = 8 << 20
"""Larger files go by resumable upload."""
PLAIN_FILES = frozenset({"result", "poster", "sheet", "preview"})
POLL_INTERVAL_S = 0.2
"""Seconds between requests for the state of a job."""
RETRY_S = 60.0
"""Time for which `watch` and `wait` retry while the service does not answer, seconds."""


def _quiet(done: int, total: int) -> None:
    """Progress callback that does nothing."""


class Client:
    """Talks to one service. A context manager; not for several threads at once.

    Args:
        server: address without `/v1`, for example "https://impasto.example.org".
        api_key: sent as a bearer token; empty where the service is open (loopback).
        timeout_s: seconds to connect, and between bytes of an answer.
        transport: HTTP transport, for tests.
    """

    def __init__(
        self,
        server: str = DEFAULT_SERVER,
        api_key: str = "",
        timeout_s: float = 30.0,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        headers = {"Authorization": f"Bearer {api_key}"} if api_key else {}
        timeout = httpx.Timeout(timeout_s)
        self.server = server.rstrip("/")
        self._http = httpx.Client(base_url=f"{self.server}/v1", headers=headers, timeout=timeout, transport=transport)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    # -- methods

    def methods(self) -> list[Json]:
        """Every method the service offers."""
        return self._items("/methods")

    def method(self, name: str) -> Json:
        """One method with the JSON Schema of its parameters, its inputs and examples."""
        return self._json("GET", f"/methods/{name}")

    # -- assets

    def upload(self, path: str | Path, progress: transfer.Progress = _quiet) -> Json:
        """Send a file unless the service has these bytes already; return the asset. Large files are resumable.

        Raises: BadInput (no such file), BadMedia (the file is invalid), QuotaExceeded.
        """
        file = Path(path)
        if not file.is_file():
            raise BadInput("File not found.", field="path", value=file, remedy="Check the path.")
        asset_id = f"ast_{transfer.sha256_of(file)}"
        try:
            return self.asset(asset_id)
        except NotFound:
            return self._send_file(file, asset_id, progress)

    def _send_file(self, file: Path, asset_id: str, progress: transfer.Progress) -> Json:
        if file.stat().st_size > SMALL_BYTES:
            last = transfer.upload(self._http, "/uploads", file, progress)
            return self.asset(last.headers.get("Impasto-Asset", asset_id))
        with file.open("rb") as stream:
            sent = self._json("POST", "/assets", files={"file": (file.name, stream)})
        progress(file.stat().st_size, file.stat().st_size)
        return sent

    def asset(self, asset_id: str) -> Json:
        return self._json("GET", f"/assets/{asset_id}")

    # -- jobs

    def submit(
        self,
        method: str,
        inputs: Mapping[str, str],
        params: Mapping[str, object] | None = None,
        *,
        idempotency_key: str = "",
        **more: object,
    ) -> Json:
        """Submit a job. `inputs`: input name -> asset id. `more`: seed, frames, output, priority, name, labels,
        webhook, on_damage, source.

        Without `idempotency_key` each call creates a job; with one, the same request returns the same job.
        Raises: BadParameter, NotFound (an asset), IdempotencyMismatch, QuotaExceeded.
        """
        body = {"method": method, "inputs": dict(inputs), "params": dict(params or {}), **more}
        headers = {"Idempotency-Key": idempotency_key or uuid.uuid4().hex}
        return self._json("POST", "/jobs", json=body, headers=headers)

    def job(self, job_id: str) -> Json:
        return self._json("GET", f"/jobs/{job_id}")

    def jobs(self, **filters: object) -> list[Json]:
        """The newest jobs. `filters`: state, method, label, limit, cursor."""
        return self._items("/jobs", **filters)

    def newest_jobs(self, most: int) -> Iterator[Json]:
        """The newest jobs, at most `most`, read page by page."""
        cursor, left = None, most
        while left > 0:
            page = self._json("GET", "/jobs", params={"limit": min(left, 200)} | ({"cursor": cursor} if cursor else {}))
            yield from page["items"]
            left, cursor = left - len(page["items"]), page["cursor"]
            if cursor is None:
                return

    def cancel(self, job_id: str) -> Json:
        return self._json("POST", f"/jobs/{job_id}/cancel")

    def requeue(self, task_id: str) -> Json:
        """Run a failed or cancelled task again; return the task."""
        return self._json("POST", f"/tasks/{task_id}/requeue")

    def retry(self, job_id: str) -> Json:
        """Run the failed and cancelled tasks again."""
        return self._json("POST", f"/jobs/{job_id}/retry")

    def delete(self, job_id: str) -> None:
        """Delete a finished job and its files."""
        self._send("DELETE", f"/jobs/{job_id}")

    def events(self, job_id: str, after: int = 0) -> Iterator[ServerEvent]:
        """A job's events with seq > `after` until it ends; reconnects as needed."""
        for event in follow(self._http, f"/jobs/{job_id}/events", after=after):
            if event is not None:
                yield event
            if (event is None or event.type == "job.state") and self.job(job_id)["state"] in FINAL:
                return

    def watch(self, job_id: str, poll_s: float = 1.0) -> Iterator[Json]:
        """The job now and after each change, until it ends. Survives restarts of the service."""
        previous: Json = {}
        for job in self._poll(job_id, poll_s):
            if job != previous:
                previous = job
                yield job

    def wait(self, job_id: str, timeout_s: float = float("inf")) -> Json:
        """Block until the job has succeeded, and return it.

        Raises: JobFailed (its `job` is the job); TimeoutError, up to 15 s late while the job makes no progress.
        """
        deadline = time.monotonic() + timeout_s
        for job in self._poll(job_id, 1.0):
            if job["state"] in FINAL:
                return _succeeded(job)
            if time.monotonic() > deadline:
                break
        raise TimeoutError(f"Job {job_id} has not ended after {timeout_s} s.")

    def _poll(self, job_id: str, poll_s: float) -> Iterator[Json]:
        """The job after each event or heartbeat, at most five times a second, up to its end."""
        job, last = self.job(job_id), time.monotonic()
        yield job
        events = follow(self._http, f"/jobs/{job_id}/events", poll_s=poll_s)
        while job["state"] not in FINAL:
            event = next(events)
            urgent = event is None or event.type == "job.state"
            if urgent or time.monotonic() - last > POLL_INTERVAL_S:
                job, last = self._job_with_retries(job_id), time.monotonic()
                yield job

    def download(
        self, job_id: str, path: str | Path, name: str = "result", progress: transfer.Progress = _quiet
    ) -> Path:
        """Fetch a job's file into `path`, which appears whole or not at all.

        `name`: "result", "poster", "sheet", "preview", or an artefact's name.
        """
        target = Path(path)
        where = f"/jobs/{job_id}/{name}" if name in PLAIN_FILES else f"/jobs/{job_id}/files/{name}"
        transfer.download(self._http, where, target, progress)
        return target

    # -- operators

    @property
    def ops(self) -> Ops:
        """Operators' calls: queue, workers, failures. They need an admin key."""
        return Ops(self._json, self._send)

    # -- HTTP

    def _items(self, path: str, **query: object) -> list[Json]:
        found = self._json("GET", path, params={k: v for k, v in query.items() if v is not None})
        items: list[Json] = found["items"]
        return items

    def _json(self, verb: str, path: str, **more: Any) -> Json:
        answer: Json = self._send(verb, path, **more).json()
        return answer

    def _send(self, verb: str, path: str, **more: Any) -> httpx.Response:
        try:
            response = self._http.request(verb, path, **more)
        except httpx.TransportError as error:
            raise ServiceUnreachable(
                f"No answer: {error or type(error).__name__}.",
                field="server",
                value=self.server,
                remedy="Start one with `impasto serve`, or give its address with --server.",
            ) from error
        if response.is_error:
            raise error_of(response)
        return response

    def _job_with_retries(self, job_id: str) -> Json:
        deadline = time.monotonic() + RETRY_S
        while True:
            try:
                return self.job(job_id)
            except ServiceUnreachable:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.5)


def _succeeded(job: Json) -> Json:
    if job["state"] != "succeeded":
        raise job_failed(job)
    return job
