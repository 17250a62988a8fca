"""Rules of the store that are broken on purpose, one at a time; the random work must detect each."""

from __future__ import annotations

import inspect
import textwrap
from dataclasses import dataclass
from typing import Any

import pytest

from workers.jobs import state_machine
from workers.scheduling.garbage_collector import GarbageCollector
from workers.store import fair_scheduler, jobs, task_queue
from workers.store.job_transaction import JobTransaction
from workers.store.jobs import Jobs
from workers.store.plans import Plans
from workers.store.task_queue import TaskQueue


@dataclass(frozen=True)
class Mutation:
    """A function with other source text.

    Attributes:
        owner: module or class of the function.
        changes: pairs of source text, each of which occurs once, and what stands there instead.
        seed: one with which random work detects it within 100 steps, of twenty that were tried (2026-11-25).
    """

    name: str
    owner: Any
    function: str
    changes: tuple[tuple[str, str], ...]
    seed: int | None = None

    def apply(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Replace the function until the end of the test."""
        original = getattr(self.owner, self.function)
        plain = inspect.unwrap(original)
        source = textwrap.dedent(inspect.getsource(plain))
        for old, new in self.changes:
            assert source.count(old) == 1, f"{self.name}: {old!r} occurs {source.count(old)} times"
            source = source.replace(old, new)
        made: dict[str, Any] = {}
        exec(compile(f"from __future__ import annotations\n{source}", "mutation", "exec"), plain.__globals__, made)
        monkeypatch.setattr(self.owner, self.function, made[self.function])
        for event, handler in state_machine._HANDLERS.items():
            if handler is original:
                monkeypatch.setitem(state_machine._HANDLERS, event, made[self.function])


MUTATIONS = (
    Mutation("the fence ignores which attempt runs the task", task_queue, "_find_current",
             (('or attempt["outcome"] != RUNNING', ""), ('task["attempt_id"] != attempt_id or ', "")), seed=11),
    Mutation("an ended attempt stays open", task_queue, "_end",
             (('"outcome": _OUTCOMES[type(event)]', '"outcome": RUNNING'),), seed=6),
    Mutation("the quota of jobs is off by one", Jobs, "_check_quota",
             (("active >= max_active", "active > max_active"),)),
    Mutation("cancel forgets running tasks", JobTransaction, "_end_running",
             (("self._cancel_tasks(TaskState.RUNNING)", "pass"),), seed=9),
    Mutation("retry counts blocked tasks as ready", jobs, "_count_blocked",
             (("tasks.c.blockers > 0", "tasks.c.blockers > 9"),), seed=15),
    Mutation("a task that is done frees none", JobTransaction, "_free_dependents",
             (("tasks.c.blockers == 0", "tasks.c.blockers == 9"),), seed=8),
    Mutation("there is no fence", task_queue, "_find_current",
             (('or attempt["outcome"] != RUNNING', ""),
              ('task["attempt_id"] != attempt_id or task["state"] != TaskState.RUNNING.value', "False"))),
    Mutation("a retried job ignores the quota", Jobs, "_check_reopening",
             (("if RunState", "if False and RunState"),)),
    Mutation("the limit of running tasks is off by one", fair_scheduler, "lanes",
             (("lane.running < lane.most", "lane.running <= lane.most"),)),
    Mutation("cancel forgets running attempts", JobTransaction, "_end_running",
             (("self.connection.execute(update(attempts).where(*running).values(ended))", "pass"),)),
    Mutation("retry forgets that tasks wait for others", JobTransaction, "_restart_tasks",
             ((".values(blocked)", ".values(free)"),)),
    Mutation("used slot time is forgotten", JobTransaction, "charge",
             (("self._used_s += max(0.0, seconds)", "pass"),)),
    Mutation("a step is planned twice", Plans, "_unplanned", ((' and not row["planned"]', ""),)),
    Mutation("an ended job is planned", Plans, "_unplanned", ((' and not RunState(row["state"]).final', ""),)),
    Mutation("every change of state sends a message", JobTransaction, "_announce",
             (("if run.final and url", "if url"),)),
    Mutation("a failed task is tried once too often", state_machine, "_failed",
             (("failures >= state", "failures > state"),)),
    Mutation("a failed task does not wait", JobTransaction, "delay",
             (("ready_at=self.now + seconds", "ready_at=self.now"),)),
    Mutation("an expired lease counts", TaskQueue, "interrupt",
             (("leases.c.lease_until >= now,", "leases.c.lease_until >= now - 60,"),)),
    Mutation("blobs of unfinished jobs are deleted", GarbageCollector, "_is_over",
             (("not self._store.jobs.exists(job_id)", "True"),)),
)  # fmt: skip
