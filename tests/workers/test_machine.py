"""Number of concurrent tasks on a machine: by processors, memory, live sessions, and fairly between owners."""

from __future__ import annotations

import re
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.kernels import processors
from pipeline.methods.abstraction import Abstraction
from pipeline.methods.base import Resources
from tests.conftest import ROOT
from tests.workers.conftest import request_on
from tests.workers.test_child_runner import order as any_order
from tests.workers.toy import ToyRunner
from workers.blobs.disk import DiskBlobs
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.contract.request import OutputSpec
from workers.farm import Farm
from workers.jobs.state_machine import ASSEMBLE
from workers.pools.base import Report
from workers.pools.local_pool import LocalPool, task_cpus
from workers.pools.machine import Machine, max_processes, this_machine
from workers.settings import FarmSettings

GIB, MIB = 1 << 30, 1 << 20
PAGE = (ROOT / "docs" / "operations.md").read_text()
DECLARED = {"abstraction": 908, "multistyle": 776, "patches": 951, "analogy": 1054}
"""MiB that docs/measurements/farm.md lists for these sizes."""
CPUS = {"abstraction": Abstraction.task_cpus}


def machine(cpus: int, memory_gib: float) -> Machine:
    """A machine as `this_machine` describes it, with this much memory, less that of the child processes."""
    memory = int(0.75 * memory_gib * GIB) - 512 * MIB
    return Machine(cpus, memory - max_processes(cpus, memory) * 512 * MIB)


def test_a_task_counts_with_the_processors_that_it_or_its_method_declares() -> None:
    plain = any_order(1)
    assert task_cpus(replace(plain, method="abstraction")) == Abstraction.task_cpus
    assert task_cpus(replace(plain, method="patches")) == 1.0
    own = Resources(cpus=3.5)
    assert task_cpus(replace(plain, method="abstraction", resources=own)) == 3.5
    assert task_cpus(replace(plain, step=ASSEMBLE)) == 1.0


def admitted(chosen: Machine, memory_gib: float, method: str) -> int:
    """Number of tasks of a method that run at once if there are unlimited tasks."""
    resources = Resources(gpus=None if method == "analogy" else 0.0, memory_bytes=DECLARED[method] * MIB)
    share = chosen.share_of(resources, CPUS.get(method, 1.0), GIB)
    begun, most = 0, max_processes(int(chosen.cpus), int(0.75 * memory_gib * GIB) - 512 * MIB)
    while chosen.free and begun < most:
        chosen.admit(f"att_{begun}", share)
        begun += chosen.wait(f"att_{begun}", 0)
    return begun


@pytest.mark.parametrize("row", re.findall(r"^\| `(\w+)`, \d+x\d+([^|]*)\|(.*)\|$", PAGE, re.M), ids=str)
def test_the_documented_numbers_of_simultaneous_tasks(row: tuple[str, str, str]) -> None:
    method, condition, numbers = row
    live = 3 if "three live" in condition else int("one live" in condition)
    found = []
    for cpus, memory_gib in ((2, 8), (4, 16), (16, 64), (16, 4)):
        chosen = machine(cpus, memory_gib)
        chosen.live_sessions, chosen.device_is_cpu = lambda: live, lambda: "on processors" in condition
        found.append(admitted(chosen, memory_gib, method))
    assert found == [int(number) for number in numbers.split("|")]


def test_a_task_that_needs_more_than_the_machine_has_runs_alone() -> None:
    chosen = machine(4, 4)
    small, huge = (chosen.share_of(Resources(gpus=0.0, memory_bytes=n * GIB), 1.0, GIB) for n in (1, 64))
    chosen.admit("small", small)
    chosen.admit("huge", huge)
    chosen.admit("late", small)
    assert chosen.wait("small", 0)
    assert not chosen.wait("huge", 0)
    assert not chosen.wait("late", 0), "nothing overtakes"
    assert chosen.free == 0
    chosen.release("small")
    assert chosen.wait("huge", 0)
    assert not chosen.wait("late", 0)
    chosen.release("huge")
    assert chosen.wait("late", 0)


def test_limits_of_the_container_count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(processors, "_CGROUP", tmp_path)
    (tmp_path / "cpu.max").write_text("50000 100000\n")
    (tmp_path / "memory.max").write_text(f"{2 * GIB}\n")
    assert (this_machine().cpus, this_machine().memory_bytes) == (1, int(1.5 * GIB) - 512 * MIB)
    (tmp_path / "cpu.max").write_text("max 100000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert this_machine().cpus >= 1
    assert this_machine().memory_bytes > 0


class Sleeper:
    """A runner whose tasks take a fixed time, and which counts those that run at once."""

    def __init__(self, counts: Counts) -> None:
        self._counts = counts

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
        with self._counts.running():
            time.sleep(0.1)
        return TaskOutcome(order.attempt_id, {}, {}, {}, None, {}, "")

    def close(self) -> None: ...

    def warm_up(self, stopped: Callable[[], bool]) -> None: ...


class Counts:
    """Number of tasks that run now, and its maximum."""

    def __init__(self) -> None:
        self.now = self.most = 0
        self._lock = threading.Lock()

    def running(self) -> Counts:
        return self

    def __enter__(self) -> None:
        with self._lock:
            self.now += 1
            self.most = max(self.most, self.now)

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self.now -= 1


def order(number: int, memory_mib: int) -> TaskOrder:
    resources = Resources(gpus=0.0, memory_bytes=memory_mib * MIB)
    return TaskOrder(
        f"att_{number}", "job_1", f"tsk_{number}", "draw", "toy", f"run-{number}", {}, None, {}, 0, {}, {},
        OutputSpec(), {}, {}, resources=resources,
    )  # fmt: skip


@pytest.mark.parametrize(("cpus", "memory_gib", "at_once"), [(2, 8, 2), (4, 16, 4), (16, 64, 16), (16, 4, 2)])
def test_a_pool_keeps_the_machine_busy_and_no_more(cpus: int, memory_gib: int, at_once: int) -> None:
    counts, ended, tasks = Counts(), threading.Semaphore(0), 3 * at_once
    pool = LocalPool(lambda number: Sleeper(counts), at_once, machine(cpus, memory_gib))
    pool.start(lambda report: ended.release() if report.outcome is not None else None)
    number = 0
    while number < tasks:
        if pool.free:
            pool.submit(order(number, 951))
            number += 1
        time.sleep(0.001)
    assert all(ended.acquire(timeout=10) for _ in range(tasks))
    pool.stop()
    assert counts.most == at_once


def test_a_waiting_attempt_can_be_cancelled() -> None:
    reports: list[Report] = []
    counts = Counts()
    pool = LocalPool(lambda number: Sleeper(counts), 4, machine(4, 2))
    pool.start(reports.append)
    for number in range(2):
        pool.submit(order(number, 8192))
    pool.cancel("att_1")
    deadline = time.monotonic() + 5
    while len([report for report in reports if report.outcome]) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert {report.attempt_id for report in reports if report.outcome} == {"att_0", "att_1"}
    pool.stop()


def test_two_owners_share_four_processors(settings: FarmSettings, tmp_path: Path) -> None:
    """Alice's eight tasks came first; Bob's tasks run beside them, not after them."""
    data = tmp_path / "data.json"
    data.write_text("{}")
    blobs = DiskBlobs(settings.blobs_at)
    begun: list[str] = []

    class Noting(ToyRunner):
        def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome:
            if order.step == "draw":
                begun.append(order.job_id)
            return super().run(order, report, cancelled)

    farm = Farm(settings, LocalPool(lambda number: Noting(blobs), 4, machine(4, 16)))
    params = {"tasks": 8, "sleep_s": 0.3}
    jobs = [farm.jobs.submit(request_on(farm, data, owner, params=params), owner).id for owner in ("alice", "bob")]
    farm.start()
    deadline = time.monotonic() + 60
    while not all(farm.jobs.get(job).state.final for job in jobs) and time.monotonic() < deadline:
        time.sleep(0.05)
    farm.stop()
    assert Counter(begun) == dict.fromkeys(jobs, 8)
    assert Counter(begun[2:10])[jobs[1]] >= 3, begun
