"""Random commands, crashes, late answers and clock steps on a whole store, against a simple model.

After every step all jobs equal the model's, and `validate_state` finds nothing. `IMPASTO_FARM_STEPS` sets the number of
steps on SQLite (PostgreSQL makes a quarter); `make chaos` makes ten thousand.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from pipeline.methods.base import Task
from tests.contracts.farm_model import FINAL, ModelJob
from tests.real.postgres import Postgres
from workers.blobs.disk import DiskBlobs
from workers.errors import Conflict
from workers.jobs import state_machine as machine
from workers.model import Asset, Fault, JobRequest, TaskOutcome
from workers.scheduling.garbage_collector import GarbageCollector
from workers.store import Accepted, Claim, Store, StorePolicy, schema

STEPS = int(os.environ.get("IMPASTO_FARM_STEPS", "1200"))
STEPS_AT_ONCE = 50
LEASE_S = 30.0
ASSET = Asset("ast_" + "a" * 64, "a" * 64, 10, "cat.mp4", "video/mp4", "video", {"frames": 4}, 1.0, "anna")
Shape = tuple[tuple[str, tuple[str, ...]], ...]
"""Keys of tasks, and of the tasks that each waits for."""
SHAPES: tuple[Shape, ...] = (
    (("a", ()),),
    (("a", ()), ("b", ("a",)), ("c", ())),
    (("a", ()), ("b", ()), ("c", ("a", "b"))),
    (),
)
OWNERS = ("anna", "ben")
DISPATCHERS = ("dsp_1", "dsp_2")
ENDS = ("succeed", "succeed", "succeed", "succeed", "fail", "fail for good", "release")
ACTIONS = (
    *["submit"] * 2, *["plan"] * 4, *["claim"] * 7, *["complete"] * 6, *["command"] * 4,
    *["complete_late"] * 2, "crash", "freeze", "time_passes", "clock_steps", "collect_garbage",
)  # fmt: skip
Draw = Callable[[st.SearchStrategy[Any]], Any]


class FarmMachine(RuleBasedStateMachine):
    """One store, two dispatchers, a garbage collector, and a clock that also steps back."""

    store: ClassVar[Store]
    folder: ClassVar[Path]
    clock: ClassVar[list[float]]
    steps: ClassVar[int] = 0
    ends: ClassVar[set[str]]
    """States that jobs have reached."""

    @initialize()
    def begin(self) -> None:
        with self.store._db.write() as connection:
            for table in reversed(schema.metadata.sorted_tables):
                connection.execute(table.delete())
        self.store.assets.add(ASSET, lambda: True)
        self.clock[0] = 10_000.0
        self.jobs: dict[str, ModelJob] = {}
        self.running: dict[str, tuple[str, str, str]] = {}
        """Attempt -> job, key, dispatcher, of attempts that count."""
        self.ended: list[str] = []
        """Attempts that count no more."""
        shutil.rmtree(self.folder / "blobs", ignore_errors=True)
        self.blobs = DiskBlobs(self.folder / "blobs")
        self.collector = GarbageCollector(self.store, self.blobs, 3600.0, lambda: True)
        for shape, owner in zip(SHAPES, OWNERS * 2, strict=True):
            self._submit(shape, owner, 0)

    @rule(data=st.data())
    def act(self, data: st.DataObject) -> None:
        """One rule for all actions, of those that can do something now: Hypothesis leaves whole rules out of most runs,
        and without plans and claims nothing happens."""
        possible = {
            "submit": len(self.jobs) < 6,
            "plan": any(job.active and not job.planned for job in self.jobs.values()),
            "complete": bool(self.running),
            "complete_late": bool(self.ended),
            "command": bool(self.jobs),
        }
        actions = [action for action in ACTIONS if possible.get(action, True)]
        getattr(self, data.draw(st.sampled_from(actions)))(data.draw)

    # -- users

    def submit(self, draw: Draw) -> None:
        self._submit(draw(st.sampled_from(SHAPES)), draw(st.sampled_from(OWNERS)), draw(st.integers(0, 1)))

    def _submit(self, shape: Shape, owner: str, priority: int) -> None:
        request = JobRequest("toy", {"video": ASSET.id}, priority=priority, webhook="https://example.org")
        accepted = Accepted(request, {}, (("draw", "Draw"), ("assemble", "Join")))
        self.jobs[self.store.jobs.add(accepted, owner).id] = ModelJob(owner, priority, shape)

    def command(self, draw: Draw) -> None:
        job_id = draw(st.sampled_from(sorted(self.jobs)))
        job = self.jobs[job_id]
        allowed = {
            "pause": job.active, "resume": job.state == "paused", "cancel": job.state not in FINAL,
            "retry": job.state in ("failed", "cancelled"), "delete": job.state in FINAL,
        }  # fmt: skip
        command = draw(st.sampled_from([*(name for name in allowed if allowed[name]), *allowed]))
        if not allowed[command]:
            with pytest.raises(Conflict):
                self._send(command, job_id)
            return
        self._send(command, job_id)
        if command == "delete":
            del self.jobs[job_id]
            self._forget(job_id)
            return
        getattr(job, command)()
        if command == "cancel":
            self._forget(job_id)

    def _send(self, command: str, job_id: str) -> None:
        jobs = self.store.jobs
        events = {"pause": machine.Pause, "resume": machine.Resume, "cancel": machine.Cancel}
        if command in events:
            jobs.command(job_id, events[command]())
        elif command == "retry":
            jobs.retry(job_id)
        else:
            jobs.remove(job_id)

    def _forget(self, job_id: str) -> None:
        for attempt_id in [name for name, (job, _, _) in self.running.items() if job == job_id]:
            del self.running[attempt_id]
            self.ended.append(attempt_id)

    # -- dispatchers

    def plan(self, draw: Draw) -> None:
        for todo in self.store.plans.to_plan(2):
            job = self.jobs[todo.job_id]
            assert todo.step == job.step and not job.planned and job.active
            shape = job.shape if todo.step == 0 else (("assemble", ()),)
            assert self.store.plans.planned(todo.job_id, todo.step, [Task(key, after=after) for key, after in shape])
            assert not self.store.plans.planned(todo.job_id, todo.step, []), "a second plan of the same step"
            job.plan()

    def claim(self, draw: Draw) -> None:
        dispatcher = draw(st.sampled_from(DISPATCHERS))
        claim = self.store.queue.claim(dispatcher, LEASE_S)
        self.store.queue.renew(dispatcher, LEASE_S)
        if claim is None:
            assert not any(job.claimable() for job in self.jobs.values() if job.planned), "something could run"
            return
        self._check_fair(claim)
        job, key = self.jobs[claim.job_id], claim.task["key"]
        assert key in job.claimable()
        job.claim(key, claim.attempt_id)
        self.running[claim.attempt_id] = (claim.job_id, key, dispatcher)
        self.blobs.put(f"jobs/{claim.job_id}/{claim.attempt_id}", b"frame")

    def _check_fair(self, claim: Claim) -> None:
        """The highest priority first; then the owner with the least at work."""
        waiting = [job for job in self.jobs.values() if job.claimable()]
        busy = {owner: sum(self.jobs[j].owner == owner for j, _, _ in self.running.values()) for owner in OWNERS}
        priority = claim.job["priority"]
        same = {
            job.owner for job_id, job in self.jobs.items()
            if job in waiting and self.store.jobs.get(job_id).request.priority == priority
        }  # fmt: skip
        assert all(
            self.store.jobs.get(i).request.priority <= priority for i, job in self.jobs.items() if job in waiting
        )
        assert busy[claim.job["owner"]] == min(busy[owner] for owner in same)

    def complete(self, draw: Draw) -> None:
        how = draw(st.sampled_from(ENDS))
        attempt_id = draw(st.sampled_from(sorted(self.running)))
        job_id, key, _ = self.running.pop(attempt_id)
        self.ended.append(attempt_id)
        assert self._answer(attempt_id, how)
        job = self.jobs[job_id]
        if how == "succeed":
            job.succeed(key)
        elif how == "release":
            job.give_back(key)
        else:
            job.fail(key, final=how != "fail")

    def _answer(self, attempt_id: str, how: str) -> bool:
        files = {"result": (f"jobs/{attempt_id}", "video/mp4")} if how == "succeed" else {}
        outcome = TaskOutcome(attempt_id, {}, {}, files, None, {}, "")
        if how == "release":
            return self.store.queue.put_off(attempt_id, 0.0, "")
        fault = Fault("internal-error", "It broke.")
        return self.store.queue.finish(outcome, None if how == "succeed" else machine.Failed(fault, how != "fail"))

    def complete_late(self, draw: Draw) -> None:
        attempt_id, how = draw(st.sampled_from(self.ended[-20:])), draw(st.sampled_from(["succeed", "fail", "release"]))
        assert not self._answer(attempt_id, how), "a late answer counts"

    def crash(self, draw: Draw) -> None:
        """The process dies; the others see that its lock is free."""
        dispatcher = draw(st.sampled_from(DISPATCHERS))
        self.store.queue.interrupt([dispatcher])
        self.store.queue._enlisted.discard(dispatcher)
        self._interrupted(dispatcher)

    def _interrupted(self, dispatcher: str) -> None:
        for attempt_id in [name for name, (_, _, who) in self.running.items() if who == dispatcher]:
            job_id, key, _ = self.running.pop(attempt_id)
            self.ended.append(attempt_id)
            self.jobs[job_id].give_back(key)

    # -- time and rubbish

    def time_passes(self, draw: Draw) -> None:
        seconds = draw(st.sampled_from([1.0, 5.0, LEASE_S / 2]))
        self.clock[0] += seconds
        for dispatcher in DISPATCHERS:
            self.store.queue.renew(dispatcher, LEASE_S)

    def freeze(self, draw: Draw) -> None:
        """A dispatcher is silent for longer than its lease, and another one takes over."""
        dispatcher = draw(st.sampled_from(DISPATCHERS))
        self.clock[0] += LEASE_S + 1
        other = "dsp_2" if dispatcher == "dsp_1" else "dsp_1"
        self.store.queue.renew(other, LEASE_S)
        self.store.queue.interrupt([])
        self._interrupted(dispatcher)

    def clock_steps(self, draw: Draw) -> None:
        """The clock is set; every dispatcher that lives renews its lease."""
        seconds = draw(st.sampled_from([-3600.0, 3600.0, -0.001]))
        self.clock[0] = max(1.0, self.clock[0] + seconds)
        for dispatcher in DISPATCHERS:
            self.store.queue.renew(dispatcher, LEASE_S)

    def collect_garbage(self, draw: Draw) -> None:
        self.collector.sweep()
        kept = {key.split("/")[1] for key in self.blobs.keys("jobs/")}
        assert kept <= {job_id for job_id, job in self.jobs.items() if job.state != "succeeded"}
        for attempt_id, (job_id, _, _) in self.running.items():
            assert self.blobs.size(f"jobs/{job_id}/{attempt_id}") is not None, "work in progress was deleted"

    # -- after every step

    @invariant()
    def every_job_equals_the_model(self) -> None:
        if not hasattr(self, "jobs"):
            return
        type(self).steps += 1
        found = {job.id: job for job in self.store.jobs.page(limit=50).items}
        assert found.keys() == self.jobs.keys()
        for job_id, job in self.jobs.items():
            self.ends.add(job.state)
            assert (found[job_id].state.value, found[job_id].counts) == (job.state, job.counts()), job
        assert self.store.queue.mine("dsp_1") | self.store.queue.mine("dsp_2") == self.running.keys()

    @invariant()
    def nothing_contradicts_itself(self) -> None:
        if hasattr(self, "jobs"):
            assert self.store.validation.validate_state() == []


def _run(url: str, folder: Path, steps: int) -> tuple[int, set[str]]:
    """Run about `steps` steps; how many there were, and the states of jobs."""
    clock = [10_000.0]
    policy = StorePolicy(machine.Limits(attempts=3, interruptions=1_000_000), retry_delay_s=0.0)
    store = Store(url, policy, lambda: clock[0])
    members = {"store": store, "folder": folder, "clock": clock, "ends": set()}
    made = type("Machine", (FarmMachine,), members)
    chosen = settings(
        max_examples=max(1, steps // STEPS_AT_ONCE), stateful_step_count=STEPS_AT_ONCE, deadline=None, database=None,
        derandomize=steps <= 2000, suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    try:
        run_state_machine_as_test(made, settings=chosen)
    finally:
        store.close()
    return made.steps, made.ends


def test_random_work_on_sqlite(tmp_path: Path) -> None:
    steps, states = _run(f"sqlite:///{tmp_path / 'impasto.db'}", tmp_path, STEPS)
    assert steps >= STEPS // 2 and states >= {"succeeded", "cancelled", "paused", "failed"}


def test_random_work_on_postgresql(postgres: Postgres, tmp_path: Path) -> None:
    steps, states = _run(postgres.fresh(), tmp_path, STEPS // 4)
    assert steps >= STEPS // 8 and "running" in states
