"""Random commands, crashes, late answers and clock steps on a store, against a model: a Hypothesis machine."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
)
from sqlalchemy import func, select

from pipeline.methods.base import Task
from tests.contracts.farm_model import FAILED_CODE, FINAL, ModelJob, ModelTurns
from workers.blobs.disk import DiskBlobs
from workers.contract.order import TaskOutcome
from workers.contract.record import Asset, Fault, Job
from workers.contract.request import JobRequest
from workers.errors import Conflict, IdempotencyMismatch, NotFound, QuotaExceeded
from workers.jobs import state_machine as machine
from workers.scheduling.garbage_collector import GarbageCollector
from workers.store import Accepted, Claim, Heartbeat, Store, schema

VALIDATED_ONE_IN = 5
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
MAX_JOBS, MAX_ACTIVE, MAX_RUNNING = 6, 3, 3
"""Jobs at once; unfinished jobs and running tasks of an owner."""
ENDS = ("succeed", "succeed", "succeed", "fail", "fail", "fail for good", "release")
UNLUCKY_ENDS = ("succeed", "fail", "fail")
"""Outcomes of a task that has failed before. Frequent failures let some tasks use all their attempts."""
ACTIONS = (
    *["submit"] * 2, *["plan"] * 6, *["claim"] * 10, *["complete"] * 12, *["command"] * 4, *["complete_late"] * 2,
    *["complete_superseded"] * 4, "retry_at_quota", "crash", "freeze", *["time_passes"] * 3, "clock_steps",
    "collect_garbage",
)  # fmt: skip
Draw = Callable[[st.SearchStrategy[Any]], Any]


class Attempt(NamedTuple):
    """An attempt and its task."""

    id: str
    job_id: str
    key: str


class FarmMachine(RuleBasedStateMachine):
    """One store, two dispatchers, a garbage collector, and a clock that also steps back."""

    store: ClassVar[Store]
    folder: ClassVar[Path]
    clock: ClassVar[list[float]]
    steps: ClassVar[int] = 0
    superseded: ClassVar[int] = 0
    ends: ClassVar[set[str]]

    @initialize()
    def begin(self) -> None:
        with self.store.database.write() as connection:
            for table in reversed(schema.metadata.sorted_tables):
                connection.execute(table.delete())
        self.store.queue._known_dispatchers.clear()
        self.store.plans._last_owner = ""
        self.store.assets.add(ASSET, lambda: True)
        self.clock[0] = 10_000.0
        self.jobs: dict[str, ModelJob] = {}
        self.keys: dict[tuple[str, str], tuple[str, int]] = {}
        """Owner and idempotency key -> job and its priority."""
        self.running: dict[str, tuple[str, str, str]] = {}
        """Attempt -> job, key, dispatcher, for current attempts."""
        self.turns = ModelTurns()
        self.ended: list[Attempt] = []
        """Attempts that are no longer current."""
        shutil.rmtree(self.folder / "blobs", ignore_errors=True)
        self.blobs = DiskBlobs(self.folder / "blobs")
        self.collector = GarbageCollector(self.store, self.blobs, 3600.0, lambda: True)
        for shape, owner in zip(SHAPES, OWNERS * 2, strict=True):
            self._submit(shape, owner, 0, "")

    @rule(data=st.data())
    def act(self, data: st.DataObject) -> None:
        """One rule for all actions, of those that can do something now: Hypothesis leaves whole rules out of most runs,
        and without plans and claims nothing happens."""
        possible = {
            "submit": len(self.jobs) < MAX_JOBS,
            "plan": any(job.active and not job.planned for job in self.jobs.values()),
            "complete": bool(self.running),
            "complete_late": bool(self.ended),
            "complete_superseded": bool(self._superseded()),
            "command": bool(self.jobs),
            "retry_at_quota": bool(self._retryable()),
        }
        actions = [action for action in ACTIONS if possible.get(action, True)]
        getattr(self, data.draw(st.sampled_from(actions)))(data.draw)

    # -- users

    def submit(self, draw: Draw) -> None:
        key = draw(st.sampled_from(["", "", "k1", "k2"]))
        self._submit(draw(st.sampled_from(SHAPES)), draw(st.sampled_from(OWNERS)), draw(st.integers(0, 1)), key)

    def _submit(self, shape: Shape, owner: str, priority: int, key: str) -> None:
        request = JobRequest("toy", {"video": ASSET.id}, priority=priority, webhook="https://example.org")
        accepted = Accepted(request, {}, (("draw", "Draw"), ("assemble", "Join")))
        known = self.keys.get((owner, key))
        if known is not None and known[1] != priority:
            with pytest.raises(IdempotencyMismatch):
                self.store.jobs.add(accepted, owner, key, MAX_ACTIVE)
        elif known is None and self._active(owner) >= MAX_ACTIVE:
            with pytest.raises(QuotaExceeded):
                self.store.jobs.add(accepted, owner, key, MAX_ACTIVE)
        else:
            made = self.store.jobs.add(accepted, owner, key, MAX_ACTIVE)
            assert made.new == (known is None) and (known is None or known[0] == made.id)
            if made.new:
                self.jobs[made.id] = ModelJob(owner, priority, shape)
                if key:
                    self.keys[owner, key] = made.id, priority

    def _active(self, owner: str) -> int:
        return sum(job.owner == owner and job.state not in FINAL for job in self.jobs.values())

    def command(self, draw: Draw) -> None:
        """Commands about one job, one after another: a cancelled one that is retried, say."""
        job_id = draw(st.sampled_from(sorted(self.jobs)))
        for number in range(draw(st.sampled_from([1, 1, 2, 6]))):
            if number:
                self.every_job_equals_the_model()
            if job_id in self.jobs:
                self._command(draw, job_id, self.jobs[job_id])

    def _command(self, draw: Draw, job_id: str, job: ModelJob) -> None:
        over = job.state in FINAL and self._active(job.owner) >= MAX_ACTIVE
        allowed = {
            "pause": job.active, "resume": job.state == "paused", "cancel": job.state not in FINAL,
            "retry": job.state in ("failed", "cancelled"), "delete": job.state in FINAL,
            "requeue": bool(job.requeueable()),
        }  # fmt: skip
        possible = [name for name in allowed if allowed[name]]
        again = [name for name in possible if name in ("requeue", "retry")] * 3
        command = draw(st.sampled_from([*again, *possible, *allowed]))
        if command == "requeue":
            self._requeue(draw, job_id, job, over)
        elif not allowed[command]:
            with pytest.raises(Conflict):
                self._send(command, job_id)
        elif command == "retry" and over:
            with pytest.raises(QuotaExceeded):
                self._send(command, job_id)
        else:
            self._send(command, job_id)
            self._commanded(command, job_id, job)

    def _send(self, command: str, job_id: str) -> None:
        jobs = self.store.jobs
        events = {"pause": machine.Pause, "resume": machine.Resume, "cancel": machine.Cancel}
        if command in events:
            jobs.command(job_id, events[command]())
        elif command == "retry":
            jobs.retry(job_id, MAX_ACTIVE)
        else:
            jobs.remove(job_id)

    def _commanded(self, command: str, job_id: str, job: ModelJob) -> None:
        if command == "delete":
            del self.jobs[job_id]
            self.keys = {key: known for key, known in self.keys.items() if known[0] != job_id}
        else:
            getattr(job, command)()
        if command in ("delete", "cancel"):
            self._end([attempt_id for attempt_id, (job, _, _) in self.running.items() if job == job_id])

    def _retryable(self) -> list[str]:
        return [job_id for job_id, job in sorted(self.jobs.items()) if job.state in ("failed", "cancelled")]

    def retry_at_quota(self, draw: Draw) -> None:
        """Submit jobs up to the owner's limit, then retry one that failed or was cancelled."""
        job_id = draw(st.sampled_from(self._retryable()))
        owner = self.jobs[job_id].owner
        while self._active(owner) < MAX_ACTIVE:
            self._submit(draw(st.sampled_from(SHAPES)), owner, 0, "")
        with pytest.raises(QuotaExceeded):
            self._send("retry", job_id)

    def _requeue(self, draw: Draw, job_id: str, job: ModelJob, over: bool) -> None:
        if not job.tasks:
            return
        key = draw(st.sampled_from([*job.requeueable(), *job.tasks]))
        task_id = next(task.id for task in self.store.tasks.page(job_id).items if task.key == key)
        if key not in job.requeueable() or over:
            with pytest.raises((Conflict, QuotaExceeded)):
                self.store.jobs.requeue(task_id, MAX_ACTIVE)
        else:
            self.store.jobs.requeue(task_id, MAX_ACTIVE)
            job.requeue(key, self.clock[0])

    def _end(self, attempt_ids: list[str]) -> list[Attempt]:
        """Mark these attempts as no longer current."""
        found = [Attempt(attempt_id, *self.running.pop(attempt_id)[:2]) for attempt_id in attempt_ids]
        for attempt in found:
            self.turns.end(attempt.id, self.clock[0])
        self.ended += found
        return found

    # -- dispatchers

    def plan(self, draw: Draw) -> None:
        for todo in self.store.plans.to_plan(2):
            job = self.jobs[todo.job_id]
            assert todo.step == job.step and not job.planned and job.active
            shape = job.shape if todo.step == 0 else (("assemble", ()),)
            tasks = [Task(key, after=after) for key, after in shape]
            if cancelled := draw(st.integers(0, 9)) == 0:  # while the step was being planned
                self._send("cancel", todo.job_id)
                job.cancel()
            assert self.store.plans.planned(todo.job_id, todo.step, tasks) != cancelled
            assert not self.store.plans.planned(todo.job_id, todo.step, tasks), "a second plan of the same step"
            if not cancelled:
                job.plan()

    def claim(self, draw: Draw) -> None:
        dispatcher = draw(st.sampled_from(DISPATCHERS))
        claim = self.store.queue.claim(dispatcher, LEASE_S)
        self.store.queue.renew(dispatcher, LEASE_S)
        busy = {owner: sum(self.jobs[j].owner == owner for j, _, _ in self.running.values()) for owner in OWNERS}
        free = {
            job_id: job for job_id, job in self.jobs.items()
            if job.claimable(self.clock[0]) and busy[job.owner] < MAX_RUNNING
        }  # fmt: skip
        if claim is None:
            assert not free, "something could run"
            return
        self._check_fair(claim, free, busy)
        job, key = self.jobs[claim.job_id], claim.task["key"]
        waiting = {job.owner for job in self.jobs.values() if job.has_ready_task and busy[job.owner] < MAX_RUNNING}
        self.turns.begin(claim.attempt_id, job.owner, waiting, self.clock[0])
        assert key == job.claimable(self.clock[0])[0], "tasks are claimed in the order of the plan"
        job.claim(key, claim.attempt_id)
        self.running[claim.attempt_id] = (claim.job_id, key, dispatcher)
        self.blobs.put(f"jobs/{claim.job_id}/{claim.attempt_id}", b"frame")

    def _check_fair(self, claim: Claim, free: dict[str, ModelJob], busy: dict[str, int]) -> None:
        """The highest priority first; then the owner with the least at work; of several, the one who has used the least
        slot time; then the owner's oldest job."""
        assert claim.job_id in free, "it may not run now"
        job = free[claim.job_id]
        assert job.priority == max(other.priority for other in free.values())
        same = {job_id: other for job_id, other in free.items() if other.priority == job.priority}
        assert busy[job.owner] == min(busy[other.owner] for other in same.values())
        equal = {other.owner for other in same.values() if busy[other.owner] == busy[job.owner]}
        assert self.turns.counted_s(job.owner) == min(map(self.turns.counted_s, equal))
        assert claim.job_id == min(job_id for job_id, other in same.items() if other.owner == job.owner)

    def complete(self, draw: Draw) -> None:
        self._complete(draw, sorted(self.running))

    def _complete(self, draw: Draw, attempt_ids: list[str]) -> None:
        ((attempt_id, job_id, key),) = self._end([draw(st.sampled_from(attempt_ids))])
        ends = UNLUCKY_ENDS if self.jobs[job_id].tasks[key].failures else ENDS
        how, delay_s = draw(st.sampled_from(ends)), draw(st.sampled_from([0.0, 5.0]))
        assert self._answer(attempt_id, how, delay_s)
        assert not self._answer(attempt_id, how, delay_s), "an answer counts twice"
        job = self.jobs[job_id]
        if how == "succeed":
            job.succeed(key)
        elif how == "release":
            job.postpone(key, self.clock[0] + delay_s)
        else:
            job.fail(key, how != "fail", self.clock[0])

    def _answer(self, attempt_id: str, how: str, delay_s: float = 0.0) -> bool:
        files = {"result": (f"jobs/{attempt_id}", "video/mp4")} if how == "succeed" else {}
        outcome = TaskOutcome(attempt_id, {}, {}, files, None, {}, "")
        if how == "release":
            return self.store.queue.postpone(attempt_id, delay_s, "")
        fault = Fault(FAILED_CODE, "It broke.")
        return self.store.queue.finish(outcome, None if how == "succeed" else machine.Failed(fault, how != "fail"))

    def _superseded(self) -> list[Attempt]:
        """Ended attempts whose task another attempt runs now."""
        at_work = {(job_id, key) for job_id, key, _ in self.running.values()}
        return [attempt for attempt in self.ended if (attempt.job_id, attempt.key) in at_work]

    def complete_superseded(self, draw: Draw) -> None:
        type(self).superseded += 1
        self._complete_late(draw, self._superseded())

    def complete_late(self, draw: Draw) -> None:
        self._complete_late(draw, self.ended[-20:])

    def _complete_late(self, draw: Draw, attempts: list[Attempt]) -> None:
        """Answer for an attempt that is no longer current: nothing may change."""
        attempt, how = draw(st.sampled_from(attempts)), draw(st.sampled_from(["succeed", "fail", "release", "beat"]))
        before = self._shown(attempt.job_id)
        if how == "beat":
            self.store.queue.progress({attempt.id: Heartbeat(0.5, "late", f"jobs/{attempt.id}")})
        else:
            assert not self._answer(attempt.id, how), "a late answer counts"
        assert self._shown(attempt.job_id) == before, "a late answer has changed the job"

    def _shown(self, job_id: str) -> Job | None:
        with suppress(NotFound):
            return self.store.jobs.get(job_id)
        return None

    def crash(self, draw: Draw) -> None:
        """End the dispatcher without cleaning up; the others see that its lock is free."""
        dispatcher = draw(st.sampled_from(DISPATCHERS))
        self.store.queue.interrupt([dispatcher])
        self.store.queue._known_dispatchers.discard(dispatcher)
        self._interrupted(dispatcher)

    def _interrupted(self, dispatcher: str) -> None:
        for attempt in self._end(self._of(dispatcher)):
            self.jobs[attempt.job_id].interrupt(attempt.key)

    def _of(self, dispatcher: str) -> list[str]:
        return sorted(attempt_id for attempt_id, (_, _, who) in self.running.items() if who == dispatcher)

    # -- time and rubbish

    def time_passes(self, draw: Draw) -> None:
        seconds = draw(st.sampled_from([1.0, 5.0, LEASE_S / 2]))
        self.clock[0] += seconds
        for dispatcher in DISPATCHERS:
            self.store.queue.renew(dispatcher, LEASE_S)

    def freeze(self, draw: Draw) -> None:
        """Silence a dispatcher beyond its lease. Answers before another dispatcher takes over are still valid."""
        dispatcher = draw(st.sampled_from(DISPATCHERS))
        self.clock[0] += LEASE_S + 1
        if self._of(dispatcher) and draw(st.booleans()):
            self._complete(draw, self._of(dispatcher))
        other = "dsp_2" if dispatcher == "dsp_1" else "dsp_1"
        self.store.queue.renew(other, LEASE_S)
        self.store.queue.interrupt([])
        self._interrupted(dispatcher)

    def clock_steps(self, draw: Draw) -> None:
        """Set the clock; every live dispatcher renews its lease."""
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
        messages = self._messages()
        for job_id, job in self.jobs.items():
            job.record_state()
            self.ends.add(job.state)
            shown = found[job_id]
            assert (shown.state.value, shown.counts) == (job.state, job.counts()), job
            assert (shown.error.code if shown.error else "", messages.get(job_id, 0)) == (job.error, job.messages), job
        assert self.store.queue.attempts_of("dsp_1") | self.store.queue.attempts_of("dsp_2") == self.running.keys()
        counted = self.store.statistics.snapshot()
        for state, count in counted["jobs"].items():
            assert count == sum(job.state == state for job in self.jobs.values()), state
        for state, count in counted["tasks"].items():
            assert count == sum(job.counts()[state] for job in self.jobs.values()), state
        if self.steps % VALIDATED_ONE_IN == 0:
            assert self.store.validation.validate_state() == []

    def _messages(self) -> dict[str, int]:
        """Webhook messages of each job."""
        column = schema.deliveries.c.job_id
        with self.store.database.read() as connection:
            rows = connection.execute(select(column, func.count()).group_by(column))
            return {str(job_id): int(count) for job_id, count in rows}

    def teardown(self) -> None:
        """The history of every job must list all of its states, each once."""
        if not hasattr(self, "jobs"):
            return
        assert self.store.validation.validate_state() == []
        for job_id, job in self.jobs.items():
            events, _ = self.store.events.list(job_id, 0, 5000)
            assert [event.data["state"] for event in events if event.type == "job.state"] == job.history
            assert [event.seq for event in events] == list(range(1, len(events) + 1))
