"""A farm in memory: what the service is tested against. It runs nothing; tests move jobs along by hand."""

from __future__ import annotations

import hashlib
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.errors import BadParameter, UnreadableMedia
from pipeline.methods import method as find_method
from pipeline.methods import parse_params
from workers.errors import Conflict, IdempotencyMismatch, NotFound
from workers.farm import ApiKey, Delivery, Page, Served
from workers.fleet import Fleet
from workers.ids import new_id
from workers.live.live import Live
from workers.live.seats import NoSeat, Seat
from workers.model import Asset, Event, Fault, Job, JobRequest, RunState, Submitted, TaskState, TaskView
from workers.settings import FarmSettings
from workers.store import Store

MAGIC = b"CLIP"
"""What bytes begin with that this farm takes for a video."""
PIECE = 1000


class FakeKeys:
    def __init__(self, farm: FakeFarm) -> None:
        self._farm = farm
        self._keys: dict[str, ApiKey] = {}

    def create(self, name: str, scopes: Collection[str], quotas: Mapping[str, int] | None = None) -> tuple[ApiKey, str]:
        key = ApiKey(new_id("key_"), name, frozenset(scopes), dict(quotas or {}), time.time())
        secret = f"imp_{key.id}"
        self._keys[secret] = key
        return key, secret

    def list(self) -> list[ApiKey]:
        return list(self._keys.values())

    def revoke(self, key_id: str) -> ApiKey:
        for secret, key in self._keys.items():
            if key.id == key_id:
                self._keys[secret] = replace(key, revoked_at=key.revoked_at or time.time())
                return self._keys[secret]
        raise NotFound("There is no such key.", field="key_id", value=key_id)

    def verify(self, secret: str) -> ApiKey | None:
        key = self._keys.get(secret)
        return key if key and key.revoked_at is None else None

    def usage(self, key_id: str) -> dict[str, int]:
        jobs = [job for job in self._farm.all_jobs.values() if job.owner == key_id and not job.state.final]
        assets = [asset for (_, owner), asset in self._farm.all_assets.items() if owner == key_id]
        return {"active_jobs": len(jobs), "asset_bytes": sum(asset.size_bytes for asset in assets)}


class FakeWebhooks:
    def __init__(self) -> None:
        self.outbox: dict[str, Delivery] = {}
        self.outcomes: list[tuple[str, int | None, str]] = []

    def due(self, limit: int = 20, lease_s: float = 60.0) -> list[Delivery]:
        now = time.time()
        due = [d for d in self.outbox.values() if d.state == "waiting" and (d.next_at or 0) <= now][:limit]
        for delivery in due:
            self.outbox[delivery.id] = replace(delivery, next_at=now + lease_s)
        return due

    def record(self, delivery_id: str, status: int | None, error: str = "") -> Delivery:
        self.outcomes.append((delivery_id, status, error))
        old = self.outbox[delivery_id]
        done = status is not None and 200 <= status < 300
        next_at = None if done else time.time() + 0.05 * 2**old.tries
        state = "delivered" if done else "waiting"
        new = replace(old, tries=old.tries + 1, state=state, next_at=next_at, last_error=error)
        self.outbox[delivery_id] = new
        return new

    def of_job(self, job_id: str) -> list[Delivery]:
        return [delivery for delivery in self.outbox.values() if delivery.job_id == job_id]


class _NoSeats:
    """Live sessions are tested with a real farm: nothing is painted here."""

    kind = "none"

    def start(self) -> None: ...
    def stop(self) -> None: ...

    async def take(self) -> Seat:
        raise NoSeat("Nothing is painted here.")


class FakeFarm:
    def __init__(self, events_kept: int = 1000) -> None:
        self.keys = FakeKeys(self)
        self.webhooks = FakeWebhooks()
        self.live = Live(_NoSeats(), FarmSettings(live_sessions=2))
        self.all_assets: dict[tuple[str, str], Asset] = {}
        """(id, owner) -> as that owner holds it"""
        self.all_jobs: dict[str, Job] = {}
        self.all_tasks: dict[str, TaskView] = {}
        self.files: dict[tuple[str, str], tuple[bytes, str]] = {}
        self.parts = {"store": "ok", "blobs": "ok", "pool": "ok"}
        self.preview_gate = threading.Event()
        self.preview_gate.set()
        self._bytes: dict[str, bytes] = {}
        self._idempotent: dict[tuple[str, str], tuple[JobRequest, str]] = {}
        self._events: dict[str, list[Event]] = {}
        self._kept = events_kept
        self._news = threading.Condition()

    # -- what tests do to jobs

    def move(self, job_id: str, state: RunState, error: Fault | None = None) -> Job:
        job = replace(self.all_jobs[job_id], state=state, updated_at=time.time(), error=error)
        self.all_jobs[job_id] = job
        self.tell(job_id, "job.state", {"state": state.value})
        return job

    def tell(self, job_id: str, kind: str, data: dict[str, Any]) -> None:
        with self._news:
            told = self._events.setdefault(job_id, [])
            told.append(Event(len(told) + 1, job_id, time.time(), kind, data))
            self._news.notify_all()

    def finish(self, job_id: str, result: bytes = b"0123456789") -> Job:
        self.files[job_id, "result"] = (result, "video/mp4")
        self.all_jobs[job_id] = replace(self.all_jobs[job_id], results=("result",), progress=1.0)
        return self.move(job_id, RunState.SUCCEEDED)

    def add_task(self, job_id: str, state: TaskState = TaskState.FAILED) -> TaskView:
        task = TaskView(new_id("tsk_"), job_id, "paint", "run-0", state, 0.0, ())
        self.all_tasks[task.id] = task
        return task

    # -- Farm

    worker_id = ""

    @cached_property
    def fleet(self) -> Fleet:
        """The real one, over a database of its own."""
        return Store(f"sqlite:///{tempfile.mkdtemp()}/fleet.db").fleet

    def start(self) -> None: ...

    def drain(self, timeout_s: float) -> bool:
        return True

    def stop(self) -> None: ...

    def add_asset(self, path: Path, filename: str, owner: str = "") -> Asset:
        data = path.read_bytes()
        if not data.startswith(MAGIC):
            raise UnreadableMedia("Not a video.", field="file", value=filename, remedy="Upload a video.")
        sha = hashlib.sha256(data).hexdigest()
        asset = Asset(f"ast_{sha}", sha, len(data), filename, "video/mp4", "video", {"frames": 1}, time.time(), owner)
        self._bytes[asset.id] = data
        return self.all_assets.setdefault((asset.id, owner), asset)

    def asset(self, asset_id: str, owner: str | None = None) -> Asset:
        held = [asset for (known, by), asset in self.all_assets.items() if known == asset_id and owner in (None, by)]
        if not held:
            raise NotFound("There is no such asset.", field="asset", value=asset_id)
        return held[0]

    def assets(self, owner: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        rows = [asset for (_, by), asset in self.all_assets.items() if owner in (None, by)]
        return _page(rows, cursor, limit)

    def delete_asset(self, asset_id: str, owner: str | None = None) -> None:
        self.asset(asset_id, owner)
        if any(asset_id in j.request.inputs.values() and not j.state.final for j in self.all_jobs.values()):
            raise Conflict("A job uses it.", field="asset_id", value=asset_id, remedy="Wait.")
        for key in [key for key in self.all_assets if key[0] == asset_id and owner in (None, key[1])]:
            del self.all_assets[key]

    def asset_file(self, asset_id: str) -> Served:
        asset = self.asset(asset_id)
        return Served(asset_id, asset.size_bytes, asset.media_type, asset.filename, asset.sha256)

    def asset_frame(self, asset_id: str, index: int, max_side_px: int = 720) -> bytes:
        self.asset(asset_id)
        self.preview_gate.wait(10)
        return cv2.imencode(".jpg", np.full((18, 32, 3), min(index, 255), np.uint8))[1].tobytes()

    def submit(
        self,
        request: JobRequest,
        owner: str = "",
        idempotency_key: str = "",
        admit: Callable[[], None] = lambda: None,
    ) -> Submitted:
        if idempotency_key and (made := self._idempotent.get((owner, idempotency_key))):
            if made[0] != request:
                raise IdempotencyMismatch(
                    "Another body.", field="Idempotency-Key", value=idempotency_key, remedy="New."
                )
            return _submitted(self.all_jobs[made[1]], new=False)
        admit()
        parse_params(find_method(request.method), request.params)
        if "video" not in request.inputs:
            raise BadParameter("An input is missing.", field="inputs.video", remedy="Give it.")
        job = self._new_job(request, owner)
        if idempotency_key:
            self._idempotent[owner, idempotency_key] = (request, job.id)
        return _submitted(job, new=True)

    def _new_job(self, request: JobRequest, owner: str) -> Job:
        now = time.time()
        job = Job(new_id("job_"), RunState.QUEUED, request, owner, now, now, None, None, 0.0, None, {}, (), None, ())
        self.all_jobs[job.id] = job
        self.tell(job.id, "job.state", {"state": "queued"})
        return job

    def job(self, job_id: str) -> Job:
        return _get(self.all_jobs, job_id, "job")

    def jobs(
        self,
        state: str | None = None,
        method: str | None = None,
        owner: str | None = None,
        label: tuple[str, str] | None = None,
        cursor: str | None = None,
        limit: int = 50,
    ) -> Page:
        rows = [
            job
            for job in reversed(self.all_jobs.values())
            if state in (None, job.state)
            and method in (None, job.request.method)
            and owner in (None, job.owner)
            and (label is None or label in job.request.labels.items())
        ]
        return _page(rows, cursor, limit)

    def cancel(self, job_id: str) -> Job:
        if self.job(job_id).state.final:
            raise Conflict("It is over.", field="job_id", value=job_id, remedy="Leave it.")
        return self.move(job_id, RunState.CANCELLED)

    def pause(self, job_id: str) -> Job:
        return self.move(job_id, RunState.PAUSED)

    def resume(self, job_id: str) -> Job:
        if self.job(job_id).state is not RunState.PAUSED:
            raise Conflict("It is not paused.", field="job_id", value=job_id, remedy="Leave it.")
        return self.move(job_id, RunState.RUNNING)

    def retry(self, job_id: str) -> Job:
        if self.job(job_id).state not in (RunState.FAILED, RunState.CANCELLED):
            raise Conflict("Nothing failed.", field="job_id", value=job_id, remedy="Leave it.")
        return self.move(job_id, RunState.QUEUED)

    def delete(self, job_id: str) -> None:
        if not self.job(job_id).state.final:
            raise Conflict("It is not over.", field="job_id", value=job_id, remedy="Cancel it first.")
        del self.all_jobs[job_id]

    def tasks(self, job_id: str, state: str | None = None, cursor: str | None = None, limit: int = 100) -> Page:
        rows = [task for task in self.all_tasks.values() if task.job_id == job_id and state in (None, task.state)]
        return _page(rows, cursor, limit)

    def task(self, task_id: str) -> TaskView:
        return _get(self.all_tasks, task_id, "task")

    def task_log(self, task_id: str) -> str:
        return f"log of {self.task(task_id).key}"

    def requeue(self, task_id: str) -> TaskView:
        self.all_tasks[task_id] = replace(self.task(task_id), state=TaskState.READY)
        return self.all_tasks[task_id]

    def events(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[list[Event], bool]:
        self.job(job_id)
        told = self._events.get(job_id, [])
        kept = told[-self._kept :]
        gone = bool(kept) and after + 1 < kept[0].seq
        return [event for event in kept if event.seq > after][:limit], gone

    def wait(self, job_id: str, after: int, timeout_s: float) -> bool:
        with self._news:
            return self._news.wait_for(lambda: len(self._events.get(job_id, [])) > after, timeout_s)

    def file(self, job_id: str, name: str) -> Served:
        if name == "result" and not self.job(job_id).state.final:
            raise Conflict("It is not there yet.", field="job_id", value=job_id, remedy="Wait.")
        data, media_type = _get(self.files, (job_id, name), "file")
        return Served(f"{job_id}/{name}", len(data), media_type, f"{name}.mp4", hashlib.sha256(data).hexdigest())

    def read(self, served: Served, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        where = tuple(served.key.split("/"))
        data = self.files[where][0] if len(where) == 2 else self._bytes[served.key]
        end = served.size_bytes if stop is None else stop
        yield from (data[at : min(at + PIECE, end)] for at in range(start, end, PIECE))

    @contextmanager
    def local(self, served: Served) -> Iterator[Path]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "file"
            path.write_bytes(b"".join(self.read(served)))
            yield path

    def preview(
        self, request: JobRequest, frame: int, max_side_px: int = 640, design: dict[str, Any] | None = None,
        regions_of: str | None = None,
    ) -> bytes:  # fmt: skip
        self.preview_gate.wait(10)
        return cv2.imencode(".png", np.zeros((18, 32, 3), np.uint8))[1].tobytes()

    def direct_url(self, served: Served) -> str | None:
        return None

    def ready(self) -> dict[str, str]:
        return self.parts

    def snapshot(self) -> dict[str, Any]:
        return {}


def _submitted(job: Job, new: bool) -> Submitted:
    return Submitted(**{name: getattr(job, name) for name in Job.__dataclass_fields__}, new=new)


def _get(rows: dict[Any, Any], key: Any, kind: str) -> Any:
    try:
        return rows[key]
    except KeyError:
        raise NotFound(f"There is no such {kind}.", field=kind, value=key, remedy="Look again.") from None


def _page(rows: list[Any], cursor: str | None, limit: int) -> Page:
    try:
        start = int(cursor or 0)
        assert 0 <= start < 1 << 60
    except (ValueError, AssertionError):
        raise BadParameter("No such cursor.", field="cursor", value=cursor, remedy="Leave it out.") from None
    stop = start + limit
    return Page(tuple(rows[start:stop]), str(stop) if stop < len(rows) else None)
