"""The dispatcher under faults: workers die or stop responding, the store is down or the disk is full."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection
from pathlib import Path

import pytest

from pipeline.errors import StorageError, StorageFull
from pipeline.methods.base import Task
from tests.waiting import until
from tests.workers.conftest import finished, request_on
from tests.workers.toy import ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.contract.order import TaskOrder, TaskOutcome
from workers.farm import Farm
from workers.operator_views import Slot
from workers.pools.base import Report
from workers.pools.local_pool import Listen
from workers.scheduling.process_lock import ProcessLock
from workers.settings import FarmSettings


class ManualPool:
    """A pool that runs nothing; the test sends the outcomes."""

    def __init__(self, capacity: int = 2) -> None:
        self.capacity = capacity
        self.orders: list[TaskOrder] = []
        self.cancelled: list[str] = []
        self.abandoned: list[str] = []
        self.moved = self.moves = 0
        """Bytes that attempts have moved, and that they move between two questions."""
        self.listen: Listen = lambda report: None

    shares_memory = False

    @property
    def free(self) -> int:
        return self.capacity

    def drain(self, nodes: Collection[str]) -> None: ...

    def slots(self) -> tuple[Slot, ...]:
        return tuple(Slot(f"hand-{i}", "here") for i in range(self.capacity))

    def start(self, listen: Listen) -> None:
        self.listen = listen

    def submit(self, order: TaskOrder) -> None:
        self.orders.append(order)

    def cancel(self, attempt_id: str) -> None:
        self.cancelled.append(attempt_id)

    def abandon(self, attempt_id: str) -> str:
        self.abandoned.append(attempt_id)
        return "it was abandoned"

    def moved_bytes(self, attempt_id: str) -> int:
        self.moved += self.moves
        return self.moved

    def describe(self) -> dict[str, object]:
        return {"kind": "by hand", "workers": self.capacity, "busy": {}}

    def stop(self, grace_s: float = 5.0) -> None: ...

    def run(self, blobs: DiskBlobs, order: TaskOrder) -> None:
        outcome = ToyRunner(blobs).run(order, lambda done, preview="": None, lambda: False)
        self.listen(Report(order.attempt_id, 1.0, outcome))

    def next(self) -> TaskOrder:
        """Wait for the next order."""
        return until(lambda: self.orders and self.orders.pop(0))


@pytest.fixture
def pool() -> ManualPool:
    return ManualPool()


@pytest.fixture
def blobs(settings: FarmSettings) -> DiskBlobs:
    return DiskBlobs(settings.blobs_at)


@pytest.fixture
def manual_farm(settings: FarmSettings, pool: ManualPool) -> Callable[..., Farm]:
    def open_one(**changes: object) -> Farm:
        farm = Farm(settings.model_copy(update=changes), pool)
        opened.append(farm)
        farm.start()
        return farm

    opened: list[Farm] = []
    yield open_one  # type: ignore[misc]
    for farm in opened:
        farm.stop()


def test_the_death_of_a_worker_counts_as_an_attempt(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path
) -> None:
    farm = manual_farm()
    job = farm.jobs.submit(request_on(farm, data))
    for _ in range(3):
        pool.listen(Report(pool.next().attempt_id, lost=True, worker="w-1"))
    error = finished(farm, job.id).error
    assert error is not None
    assert error.code == "worker-lost"


def test_a_silent_worker_loses_its_attempt(manual_farm: Callable[..., Farm], pool: ManualPool, data: Path) -> None:
    farm = manual_farm(stall_s=0.5, attempts=1, interruptions=2)
    job = farm.jobs.submit(request_on(farm, data))
    first, second = pool.next(), pool.next()
    assert first.task_id == second.task_id, "it is not charged, and runs again"
    error = finished(farm, job.id).error
    assert error is not None
    assert error.code == "interrupted", "a task that always hangs ends, too"
    assert pool.abandoned == [first.attempt_id, second.attempt_id]


def test_an_attempt_that_moves_bytes_does_not_hang(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path
) -> None:
    farm = manual_farm(stall_s=0.5)
    farm.jobs.submit(request_on(farm, data))
    pool.next()
    pool.moves = 2 << 20
    time.sleep(2)
    assert pool.abandoned == []
    pool.moves = 0
    until(lambda: pool.abandoned)


def test_a_late_answer_of_an_abandoned_attempt_is_ignored(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path
) -> None:
    farm = manual_farm()
    job = farm.jobs.submit(request_on(farm, data))
    late = pool.next()
    pool.listen(Report(late.attempt_id, lost=True))
    newer = pool.next()
    pool.listen(Report(late.attempt_id, outcome=TaskOutcome(late.attempt_id, {"found": 99}, {}, {}, None, {}, "")))
    pool.listen(Report(newer.attempt_id, outcome=TaskOutcome(newer.attempt_id, {"found": 2}, {}, {}, None, {}, "")))
    until(lambda: farm.jobs.get(job.id).steps[1].counts["running"] == 2)


def test_progress_is_published_while_a_task_runs(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path
) -> None:
    farm = manual_farm()
    job = farm.jobs.submit(request_on(farm, data))
    order = pool.next()
    pool.listen(Report(order.attempt_id, 0.4, worker="w-1", preview="live-0.jpg"))
    pool.listen(Report(order.attempt_id, 0.5, worker="w-1"))
    until(lambda: farm.tasks.page(job.id).items[0].progress == 0.5)
    assert farm.tasks.page(job.id).items[0].attempts[0]["worker"] == "w-1"
    progress = [event for event in farm.jobs.events(job.id)[0] if event.type == "job.progress"]
    assert 0 < progress[-1].data["progress"] < 0.5
    assert farm.jobs.get(job.id).results == ("preview",)


def test_an_outcome_is_retried_while_the_store_is_unavailable(
    manual_farm: Callable[..., Farm], pool: ManualPool, blobs: DiskBlobs, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = manual_farm()
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 1}))
    order = pool.next()
    finish = farm.store.queue.finish
    down = time.monotonic() + 0.8

    def away(*args: object, **more: object) -> bool:
        if time.monotonic() < down:
            raise StorageError("The database does not answer.")
        return finish(*args, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(farm.store.queue, "finish", away)
    pool.run(blobs, order)
    until(lambda: "does not answer" in farm.ready()["pool"])
    for _ in range(2):
        pool.run(blobs, pool.next())
    assert finished(farm, job.id).state == "succeeded"
    assert len(farm.tasks.page(job.id).items[0].attempts) == 1, "nothing was lost, nothing ran twice"
    assert farm.ready()["pool"] == "ok"


def test_no_task_starts_while_the_disk_is_full(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = manual_farm()
    request = request_on(farm, data)
    job = farm.jobs.submit(request)
    pool.next()
    monkeypatch.setattr("workers.blobs.disk.shutil.disk_usage", lambda path: type("Usage", (), {"free": -1}))
    with pytest.raises(StorageFull):
        farm.jobs.submit(request)
    with pytest.raises(StorageFull):
        farm.assets.add(data, "data.json")
    until(lambda: "nearly full" in farm.ready()["pool"])
    assert "nearly full" in farm.ready()["blobs"]
    assert not farm.jobs.get(job.id).state.final, "what runs may end"


def test_a_deleted_job_leaves_no_blobs_of_late_attempts(
    manual_farm: Callable[..., Farm], pool: ManualPool, blobs: DiskBlobs, data: Path
) -> None:
    farm = manual_farm()
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 1}))
    pool.run(blobs, pool.next())
    drawing = pool.next()
    farm.jobs.cancel(job.id)
    until(lambda: pool.cancelled == [drawing.attempt_id])
    farm.jobs.delete(job.id)
    pool.run(blobs, drawing)
    until(lambda: list(blobs.keys("jobs/")) == [])


def test_a_running_dispatcher_is_registered_until_it_closes(tmp_path: Path) -> None:
    first, second = ProcessLock(tmp_path), ProcessLock(tmp_path)
    assert first.dead() == []
    assert not first.alone()
    os.close(second._handle)  # what the kernel does when it is killed
    assert first.dead() == [second.id]
    assert first.alone()
    first.forget([second.id])
    assert first.dead() == []
    first.end()
    assert list(tmp_path.iterdir()) == []


def test_scratch_files_of_a_crash_are_swept_without_other_live_processes(
    manual_farm: Callable[..., Farm], settings: FarmSettings
) -> None:
    left = settings.scratch / "impasto-x" / "segment"
    left.parent.mkdir(parents=True)
    left.touch()
    manual_farm()
    assert not left.exists()
    left.parent.mkdir(parents=True)
    manual_farm()
    assert left.parent.exists(), "it may be in use by the other farm"


def test_a_plan_that_cannot_be_stored_delays_no_other_job(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = manual_farm()
    planned = farm.store.plans.planned

    def fail(job_id: str, step: int, tasks: list[Task]) -> bool:
        if farm.jobs.get(job_id).request.name == "bad":
            raise TypeError("not JSON")
        return planned(job_id, step, tasks)

    monkeypatch.setattr(farm.store.plans, "planned", fail)
    broken = [farm.jobs.submit(request_on(farm, data, name="bad")) for _ in range(5)]
    sound = farm.jobs.submit(request_on(farm, data))
    assert pool.next().job_id == sound.id
    for job in broken:
        error = finished(farm, job.id).error
        assert error is not None
        assert error.code == "internal-error"


def test_a_job_whose_failed_plan_cannot_be_recorded_delays_no_other_job(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = manual_farm()

    def fail(*_: object) -> bool:
        raise TypeError("not JSON")

    def fail_bad(job_id: str, step: int, tasks: list[Task]) -> bool:
        return fail() if farm.jobs.get(job_id).request.name == "bad" else planned(job_id, step, tasks)

    planned = farm.store.plans.planned
    monkeypatch.setattr(farm.store.plans, "planned", fail_bad)
    monkeypatch.setattr(farm.store.plans, "plan_failed", fail)
    for _ in range(5):
        farm.jobs.submit(request_on(farm, data, name="bad", priority=9))
    sound = farm.jobs.submit(request_on(farm, data))
    until(lambda: any(order.job_id == sound.id for order in pool.orders))


def test_an_outcome_that_cannot_be_stored_fails_its_attempt_only(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path, blobs: DiskBlobs
) -> None:
    farm = manual_farm(attempts=1)
    job = farm.jobs.submit(request_on(farm, data))
    order = pool.next()
    pool.listen(Report(order.attempt_id, outcome=TaskOutcome(order.attempt_id, {"x": object()}, {}, {}, None, {}, "")))
    assert finished(farm, job.id).state == "failed"
    farm.jobs.submit(request_on(farm, data))
    assert pool.next().job_id != job.id


def test_an_order_that_fails_occupies_no_slot(
    manual_farm: Callable[..., Farm], pool: ManualPool, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    farm = manual_farm(attempts=1)

    def fail(order: TaskOrder) -> None:
        raise RuntimeError("the pool is confused")

    with monkeypatch.context() as patch:
        patch.setattr(pool, "submit", fail)
        jobs = [farm.jobs.submit(request_on(farm, data)) for _ in range(3)]
        assert all(finished(farm, job.id).state == "failed" for job in jobs)
    farm.jobs.submit(request_on(farm, data))
    assert pool.next()
