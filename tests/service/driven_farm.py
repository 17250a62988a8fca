"""The real farm on SQLite without a pool: tests advance jobs through the store's own interface."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.errors import UnreadableMedia
from pipeline.methods.base import Task
from pipeline.video.media import Limits, MediaInfo
from tests.databases import migrated_sqlite
from workers.contract.order import TaskOutcome
from workers.contract.record import AnyOwner, Delivery, Fault, Job, RunState, TaskState, TaskView
from workers.contract.request import JobRequest
from workers.farm import Farm
from workers.jobs.state_machine import Failed
from workers.settings import FarmSettings

MAGIC = b"CLIP"
"""Files that begin with these bytes are accepted as videos."""
DRIVER = "dsp_test"


def probe(path: Path, limits: Limits) -> MediaInfo:
    """Accept what begins with MAGIC; decoding is tested elsewhere."""
    if not path.read_bytes().startswith(MAGIC):
        raise UnreadableMedia("Not a video.", field="file", value=path.name, remedy="Upload a video.")
    return MediaInfo("video", "video/mp4", 32, 18, 1, 25.0, 0.04)


class DrivenFarm(Farm):
    """
    Attributes:
        parts: what `ready` answers.
        preview_gate: previews wait until it is set.
        outcomes: (message id, HTTP status, error) of every webhook that was tried.
    """

    def __init__(self, home: Path, **changes: Any) -> None:
        migrated_sqlite(home / "impasto.db")
        given = {"pool": "none", "reserve_bytes": 0, "live_sessions": 2}
        super().__init__(FarmSettings(home=home, **(given | changes)), None, probe=probe)
        self.parts = {"store": "ok", "blobs": "ok", "pool": "ok"}
        self.preview_gate = threading.Event()
        self.preview_gate.set()
        self.outcomes: list[tuple[str, int | None, str]] = []
        self.assets.frame, self.jobs.preview = self._frame, self._preview  # type: ignore[method-assign]
        self._record, self.webhooks.record = self.webhooks.record, self._record_and_signal  # type: ignore[method-assign]

    def ready(self) -> dict[str, str]:
        return self.parts

    def _frame(self, asset_id: str, owner: str | AnyOwner, index: int, max_side_px: int = 720) -> bytes:
        self.assets.get(asset_id, owner)
        self.preview_gate.wait(10)
        return cv2.imencode(".jpg", np.full((18, 32, 3), min(index, 255), np.uint8))[1].tobytes()

    def _preview(self, *_: Any) -> bytes:
        self.preview_gate.wait(10)
        return cv2.imencode(".png", np.zeros((18, 32, 3), np.uint8))[1].tobytes()

    def _record_and_signal(self, delivery_id: str, status: int | None, error: str = "") -> Delivery:
        made = self._record(delivery_id, status, error)
        self.outcomes.append((delivery_id, status, error))
        return made

    # -- what a dispatcher would do

    def finish(self, job_id: str, result: bytes = b"0123456789") -> Job:
        """Run the job to its end."""
        while not self.jobs.get(job_id).state.final:
            key = f"jobs/{job_id}/result.mp4"
            self.blobs.put(key, result)
            self._run(job_id, {"result": (key, "video/mp4")})
        return self.jobs.get(job_id)

    def add_file(self, job_id: str, name: str, data: bytes, media_type: str) -> None:
        """Run the job's next step; its task makes this file."""
        self.blobs.put(f"jobs/{job_id}/{name}", data)
        self._run(job_id, {name: (f"jobs/{job_id}/{name}", media_type)})

    def _run(self, job_id: str, files: dict[str, tuple[str, str]]) -> None:
        attempt_id = self._claim(job_id)
        self.store.queue.finish(TaskOutcome(attempt_id, {}, {}, files, None, {}, ""))

    def _claim(self, job_id: str) -> str:
        for todo in self.store.plans.to_plan(1000):
            if todo.job_id == job_id:
                self.store.plans.planned(job_id, todo.step, [Task("run-0")])
        running = self.tasks.page(job_id, "running").items
        if running:
            return str(running[0].attempts[-1]["id"])
        claim = self.store.queue.claim(DRIVER, 3600.0)
        assert claim is not None and claim.job_id == job_id, "tests run one job at a time"
        return claim.attempt_id

    def move(self, job_id: str, state: RunState, error: Fault | None = None) -> Job:
        """Bring a queued job into a state."""
        if state is RunState.FAILED:
            self.add_task(job_id, error=error)
        elif state is not RunState.QUEUED:
            self._claim(job_id)
        if state is RunState.PAUSED:
            self.jobs.pause(job_id)
        elif state is RunState.CANCELLED:
            self.jobs.cancel(job_id)
        return self.jobs.get(job_id)

    def add_task(self, job_id: str, state: TaskState = TaskState.FAILED, error: Fault | None = None) -> TaskView:
        """A task of the job that has failed, and the job with it."""
        assert state is TaskState.FAILED
        fault = error or Fault("internal-error", "It failed.", "See the log of the task.")
        outcome = TaskOutcome(self._claim(job_id), {}, {}, {}, None, {}, "log of run-0")
        self.store.queue.finish(outcome, Failed(fault, final=True), "worker-0")
        (task,) = self.tasks.page(job_id, "failed").items
        return task  # type: ignore[no-any-return]

    def tell(self, job_id: str, kind: str, data: dict[str, Any]) -> None:
        """Append an event to the job's history."""
        with self.store.jobs._transaction(job_id) as transaction:
            transaction.add_event(kind, data)

    def send(self, url: str) -> Delivery:
        """The webhook message of a job that has succeeded."""
        path = self._settings.home / "clip"
        path.write_bytes(MAGIC)
        inputs = {"video": self.assets.add(path, "clip.mp4").id}
        job = self.jobs.submit(JobRequest("toy", inputs, name="Mälö", webhook=url))
        self.finish(job.id)
        (message,) = self.webhooks.of_job(job.id)
        return message
