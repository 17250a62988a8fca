"""Attempts in child processes: the same results, cancellation, crashes, and an end with the parent."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import psutil
import pytest

from pipeline.errors import Cancelled
from tests.conftest import ROOT
from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from tests.workers.toy import Toy, ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.contract.request import OutputSpec
from workers.farm import Farm
from workers.pools import child_runner
from workers.pools.base import Report
from workers.pools.child_runner import ChildDied, ChildRunner
from workers.pools.local_pool import LocalPool
from workers.settings import FarmSettings


class Deaf:
    """Runs each order for a minute, and does not stop if it is cancelled. Reports the child's process id."""

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        report(0.5, str(os.getpid()))
        time.sleep(60)
        raise AssertionError

    pid = 0

    def warm_up(self, stopped: Callable[[], bool]) -> None: ...

    def kill(self) -> None: ...

    def close(self) -> None: ...


class Quick(Deaf):
    """Ends an order when it is cancelled, or at once if its key is "done"."""

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        report(0.5, str(os.getpid()))
        while order.key != "done" and not cancelled():
            time.sleep(0.01)
        return TaskOutcome(order.attempt_id, {}, {}, {}, None, {}, "", cancelled=order.key != "done")


def order(number: int, key: str = "done") -> TaskOrder:
    return TaskOrder(
        f"att_{number}", "job_1", f"tsk_{number}", "draw", "toy", key, {}, None, {}, 0, {}, {}, OutputSpec(), {}, {}
    )


@pytest.fixture
def quick() -> Iterator[ChildRunner]:
    runner = ChildRunner(Quick)
    yield runner
    runner.close()


def child_toy(root: Path) -> ToyRunner:
    """The toy's runner, in a child, where the toy is the only method, too."""
    import pipeline.methods

    pipeline.methods.methods = lambda: {"toy": Toy()}  # type: ignore[assignment]
    return ToyRunner(DiskBlobs(root))


@pytest.fixture
def farm(settings: FarmSettings) -> Iterator[Farm]:
    """A farm whose attempts all run in two children."""
    in_child = partial(child_toy, settings.blobs_at)
    farm = Farm(settings, LocalPool(lambda number: ChildRunner(in_child), 2))
    farm.start()
    yield farm
    farm.stop()


def test_a_job_has_the_same_result_as_in_threads(
    farm: Farm, data: Path, open_farm: Callable[..., Farm], tmp_path: Path
) -> None:
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 4}))
    assert finished(farm, job.id).state == "succeeded"
    other = open_farm(home=tmp_path / "other")
    same = other.jobs.submit(request_on(other, data, params={"tasks": 4}))
    assert finished(other, same.id).state == "succeeded"
    assert result(farm, job.id) == result(other, same.id)


def test_a_task_that_kills_its_process_runs_again_in_another(farm: Farm, data: Path, tmp_path: Path) -> None:
    trouble = {"tasks": 3, "trouble": "die", "mark": str(tmp_path / "mark")}
    job = farm.jobs.submit(request_on(farm, data, params=trouble))
    assert finished(farm, job.id, 60).state == "succeeded"
    attempts = [task.attempts for task in farm.tasks.page(job.id).items if len(task.attempts) > 1]
    assert len(attempts) == 1, "the other tasks are not disturbed"
    assert attempts[0][0]["error"]["code"] == "worker-died"
    assert "signal 9" in attempts[0][0]["error"]["message"]


def test_reports_and_outcome_arrive(quick: ChildRunner) -> None:
    told: list[tuple[float, str]] = []
    outcome = quick.run(order(1), lambda done, preview="": told.append((done, preview)), lambda: False)
    assert outcome == TaskOutcome("att_1", {}, {}, {}, None, {}, "")
    assert told == [(0.5, str(quick.pid))]


def test_an_attempt_is_cancelled_and_the_next_one_runs_in_the_same_process(quick: ChildRunner) -> None:
    before = quick.pid
    assert quick.run(order(1, "wait"), lambda done, preview="": None, lambda: True).cancelled
    assert not quick.run(order(2), lambda done, preview="": None, lambda: True).cancelled
    assert quick.pid == before


def test_an_attempt_that_does_not_stop_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_runner, "CANCEL_S", 0.2)
    runner = ChildRunner(Deaf)
    pid = runner.pid
    with pytest.raises(Cancelled):
        runner.run(order(1), lambda done, preview="": None, lambda: True)
    assert not psutil.pid_exists(pid)


def test_a_killed_child_is_reported_and_replaced(quick: ChildRunner) -> None:
    threading.Timer(0.3, os.kill, (quick.pid, signal.SIGKILL)).start()
    with pytest.raises(ChildDied, match="signal 9"):
        quick.run(order(1, "wait"), lambda done, preview="": None, lambda: False)
    assert not quick.run(order(2), lambda done, preview="": None, lambda: False).cancelled


def broken() -> Deaf:
    raise RuntimeError("It cannot be made.")


def test_a_child_that_does_not_start_is_reported() -> None:
    with pytest.raises(ChildDied, match="exit status 1"):
        ChildRunner(broken)


PARENT = """
import time
from tests.workers.test_child_runner import Deaf, order
from workers.pools.child_runner import ChildRunner
ChildRunner(Deaf).run(order(1), lambda done, preview="": print(preview, flush=True), lambda: False)
"""


def test_a_child_ends_with_its_parent() -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    until(lambda: not psutil.pid_exists(child))


def test_a_child_has_no_decoder_server_of_its_own(quick: ChildRunner) -> None:
    quick.run(order(1), lambda done, preview="": None, lambda: False)
    assert psutil.Process(quick.pid).children() == []


class Held(Deaf):
    """Holds its orders until the test releases them; notes who ran them."""

    def __init__(self, number: int, ran: list[int], release: threading.Semaphore, closed: threading.Semaphore) -> None:
        self.number, self.ran, self.release, self.closed = number, ran, release, closed

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        self.ran.append(self.number)
        assert self.release.acquire(timeout=10)
        return TaskOutcome(order.attempt_id, {}, {}, {}, None, {}, "")

    def close(self) -> None:
        self.closed.release()


def test_workers_start_when_orders_wait_and_end_when_they_are_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LocalPool, "idle_s", 0.2)
    ran: list[int] = []
    release, closed = threading.Semaphore(0), threading.Semaphore(0)
    reports: list[Report] = []
    pool = LocalPool(lambda number: Held(number, ran, release, closed), 3)
    pool.start(reports.append)
    for number in range(3):
        pool.submit(order(number))
    until(lambda: len(ran) == 3)
    assert sorted(ran) == [0, 1, 2]
    release.release(3)
    assert all(closed.acquire(timeout=10) for _ in range(2)), "the idle workers end, but for the first"
    assert not closed.acquire(timeout=0.5)
    assert len(pool.slots()) == 3, "a worker that has not started is a slot, too"
    for number in range(3, 6):
        pool.submit(order(number))
    until(lambda: len(ran) == 6)
    assert sorted(ran[3:]) == [0, 1, 2], "others start"
    release.release(3)
    until(lambda: sum(report.outcome is not None for report in reports) == 6)
    pool.stop()


def test_an_order_goes_to_the_worker_that_made_its_artefacts() -> None:
    ran: list[int] = []
    release, closed = threading.Semaphore(0), threading.Semaphore(0)
    reports: list[Report] = []
    pool = LocalPool(lambda number: Held(number, ran, release, closed), 2)
    pool.start(reports.append)
    pool.submit(order(0))
    until(lambda: len(ran) == 1)
    pool.submit(order(1))
    until(lambda: len(ran) == 2)
    release.release(2)
    until(lambda: pool.free == 2 and sum(report.outcome is not None for report in reports) == 2)
    made = "jobs/job_1/draw/done/att_1/state.npz"
    until(lambda: len(pool._idle) == 2)
    pool.submit(dataclasses.replace(order(2), artefacts={"draw/state": made}))
    until(lambda: len(ran) == 3)
    assert ran[2] == ran[1]
    release.release()
    pool.stop()
