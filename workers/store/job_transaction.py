"""One job, locked, in one write transaction: apply events of the state machine, append to its history.

Every change of a job uses this class, so that states, counts, history and webhook messages are always consistent.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import cast

from sqlalchemy import Connection, RowMapping, and_, bindparam, delete, insert, or_, select, update

from workers.contract.record import JobWarning, RunState, TaskState
from workers.contract.request import Json
from workers.errors import NotFound
from workers.ids import new_id
from workers.jobs import state_machine as machine
from workers.jobs.job_warnings import merged_warnings
from workers.jobs.state_machine import Counts, JobSnapshot, Limits, State, StateEvent, TaskSnapshot
from workers.store import schema, shares, task_states
from workers.store.accepted_job import Accepted, step_rows
from workers.store.job_cost import record_cost
from workers.store.records import TaskRow, Values, counts_of, fault_to_json
from workers.store.state_counts import CountChanges
from workers.version import version

_PRUNE_EVERY = 100
RUNNING = "running"
"""Outcome of an attempt that runs."""
LONGEST_WAIT_S = 300.0
"""Maximum wait of a task between attempts. A longer stored wait was written before the clock was set back."""
# Built once, because building a statement takes longer than running it.
_LOCKED = select(schema.jobs).where(schema.jobs.c.id == bindparam("id")).with_for_update()
_TASK = select(schema.tasks).where(schema.tasks.c.id == bindparam("id"), schema.tasks.c.job_id == bindparam("job_id"))
_STEP = select(schema.steps).where(
    schema.steps.c.job_id == bindparam("job_id"), schema.steps.c.step == bindparam("step")
)
_STARTED = select(schema.attempts.c.started_at).where(
    schema.attempts.c.job_id == bindparam("job_id"), schema.attempts.c.outcome == RUNNING
)
_STEPS = select(schema.steps).where(schema.steps.c.job_id == bindparam("job_id"))
ACTIVE = (RunState.QUEUED.value, RunState.RUNNING.value)
"""States of jobs that are planned and run."""


@dataclass(frozen=True)
class StorePolicy:
    """Limits of attempts, delays of retries, length of the history, and durability."""

    limits: Limits = field(default_factory=Limits)
    retry_delay_s: float = 0.5
    events_kept: int = 5000
    owner_tasks: int | None = None
    """Maximum number of running tasks of an owner whose key has no limit of its own; None: no limit."""
    durable: bool = True
    """Whether every commit survives a power cut; see `Database`."""


class JobTransaction:
    """A job under lock until the transaction ends. Call `close` last."""

    def __init__(self, connection: Connection, row: RowMapping, now: float, policy: StorePolicy) -> None:
        self.connection = connection
        self.job_id = str(row["id"])
        self.now = now
        self.row = dict(row)
        self._policy = policy
        self._changes: Values = {}
        self._events: list[Json] = []
        self._tallies = CountChanges()
        self._used_s = 0.0
        """Slot time of attempts that this transaction ends, seconds."""
        self._floor_s: float | None = None

    @classmethod
    def open(cls, connection: Connection, job_id: str, now: float, policy: StorePolicy) -> JobTransaction | None:
        """Lock the job; None if there is no such job."""
        row = connection.execute(_LOCKED, {"id": job_id}).mappings().first()
        return None if row is None else cls(connection, row, now, policy)

    @property
    def seq(self) -> int:
        """The number of the newest event."""
        return int(self.row["last_seq"]) + len(self._events)

    @property
    def changed(self) -> bool:
        return bool(self._events or self._changes)

    def task(self, task_id: str) -> TaskRow:
        """The row of a task of this job."""
        row = self.connection.execute(_TASK, {"id": task_id, "job_id": self.job_id}).mappings().first()
        if row is None:
            raise NotFound(f"There is no task {task_id}.", field="task", value=task_id)
        return cast(TaskRow, dict(row))

    def step_row(self, step: int) -> RowMapping:
        return self.connection.execute(_STEP, {"job_id": self.job_id, "step": step}).mappings().one()

    def apply(self, event: StateEvent, task: TaskRow | None = None) -> State:
        """Apply `event` (about the row `task`, if given) and write its effects. Raises Conflict."""
        before = State(self._job_snapshot(), _task_snapshot(task), self._policy.limits)
        after, effects = machine.advance(before, event)
        self._write_job(before.job, after.job)
        if task is not None and after.task is not None:
            self._write_task(task, after.task)
        for effect in effects:
            self._apply(effect, task)
        return after

    def replan(self, step: int, accepted: Accepted) -> bool:
        """Go back to `step`: see `Plans.replan`. False if the job has ended, or tasks of it run."""
        snapshot = self._job_snapshot()
        if snapshot.run.final or snapshot.counts.running:
            return False
        versions = [list(pair) for pair in accepted.versions]
        self._set(params=accepted.params, versions=versions, planned_by=version())
        if step <= self.row["step"]:
            self.apply(machine.Replanned(step, len(accepted.steps)))
        if step < len(accepted.steps):
            self._set(step_count=len(accepted.steps))
            for table in (schema.tasks, schema.steps):  # attempts and edges go with their tasks
                self.connection.execute(delete(table).where(table.c.job_id == self.job_id, table.c.step >= step))
            self.connection.execute(insert(schema.steps), step_rows(self.job_id, accepted)[step:])
        return True

    def prioritise(self, priority: int) -> None:
        """Change the priority, also in the request that is shown."""
        self._set(priority=priority, request={**self.row["request"], "priority": priority})

    def add_event(self, kind: str, data: Json) -> None:
        """Append to the job's history."""
        seq = self.seq + 1
        self._events.append({"job_id": self.job_id, "seq": seq, "at": self.now, "type": kind, "data": data})

    def add_task_event(self, task: TaskRow, state: TaskState, **more: object) -> None:
        self.add_event("task.state", {"task_id": task["id"], "key": task["key"], "state": state.value, **more})

    def add_warnings(self, warnings: Sequence[JobWarning]) -> None:
        """Merge warnings into the job's; new ones are announced by an event."""
        known = self.row["warnings"] or []
        merged = merged_warnings(known, warnings)
        for warning in merged:
            if warning not in known:
                self.add_event("job.warning", warning)
        if merged != known:
            self._set(warnings=merged)

    def take_turn(self, floor_s: float) -> None:
        """A task was claimed; `floor_s`: the least slot time of all owners who wait, see `shares`."""
        self._floor_s = floor_s

    def charge(self, seconds: float) -> None:
        """Charge the owner for an attempt that has ended."""
        self._used_s += max(0.0, seconds)

    def remove(self) -> None:
        """Delete the job."""
        steps = self.connection.execute(_STEPS, {"job_id": self.job_id}).mappings()
        for step in steps:
            for state in TaskState:
                self._tallies.tasks(state.value, -step[state.value])
        self._tallies.job(self.row["state"], -1)
        self.connection.execute(delete(schema.jobs).where(schema.jobs.c.id == self.job_id))

    def close(self) -> None:
        """Write the job's row and history, and the sums over all jobs."""
        self.close_all([self])

    @staticmethod
    def close_all(jobs: Sequence[JobTransaction]) -> None:
        """Close several jobs of one transaction. Rows that others need, too, are locked last, in a fixed order."""
        used: dict[str, float] = defaultdict(float)
        counts = CountChanges()
        for job in jobs:
            if job.changed:
                job._write()
            if job._floor_s is not None:
                shares.take_turn(job.connection, job.row["owner"], job._floor_s)
            used[job.row["owner"]] += job._used_s
            counts.add(job._tallies)
        for owner in sorted(used):
            if used[owner]:
                shares.charge(jobs[0].connection, owner, used[owner])
        if jobs:
            counts.write(jobs[0].connection, jobs[0].job_id)

    def _write(self) -> None:
        seq = self.seq
        if self._events:
            self.connection.execute(insert(schema.events), self._events)
            self._prune(seq)
        if self._changes.get("finished_at") is not None:
            record_cost(self.connection, self.row, self.now)
        changes = {**self._changes, "last_seq": seq, "updated_at": self.now}
        self.connection.execute(update(schema.jobs).where(schema.jobs.c.id == self.job_id).values(changes))

    def _prune(self, seq: int) -> None:
        if seq // _PRUNE_EVERY != self.row["last_seq"] // _PRUNE_EVERY:
            events = schema.events
            gone = seq - self._policy.events_kept
            self.connection.execute(delete(events).where(events.c.job_id == self.job_id, events.c.seq <= gone))

    # -- the machine's state, read and written

    def _job_snapshot(self) -> JobSnapshot:
        row = self.row
        counts = counts_of(self.step_row(row["step"]))
        return JobSnapshot(
            RunState(row["state"]), row["step"], row["step_count"], row["planned"], row["doomed"], counts
        )

    def _write_job(self, before: JobSnapshot, after: JobSnapshot) -> None:
        counts = after.counts if after.step == before.step else _all_done(before)
        if counts != before.counts:
            self._write_counts(before.step, before.counts, counts)
        self._tallies.job(before.run.value, -1)
        self._tallies.job(after.run.value, 1)
        self._set(state=after.run.value, step=after.step, planned=after.planned, doomed=after.failing)
        may_start = after.run.value in ACTIVE and after.planned and not after.failing
        ready = after.counts.ready if may_start else 0
        self._tallies.startable(ready - self.row["ready"])
        self._set(ready=ready)
        if after.run is RunState.RUNNING and self.row["started_at"] is None:
            self._set(started_at=self.now)
        if after.run is not before.run:
            self._set(finished_at=self.now if after.run.final else None)

    def _set(self, **values: object) -> None:
        changed = {name: value for name, value in values.items() if self.row[name] != value}
        self.row.update(changed)
        self._changes.update(changed)

    def _write_counts(self, step: int, before: Counts, counts: Counts) -> None:
        steps = schema.steps
        for state in TaskState:
            self._tallies.tasks(state.value, getattr(counts, state.value) - getattr(before, state.value))
        values = {state.value: getattr(counts, state.value) for state in TaskState}
        where = (steps.c.job_id == self.job_id, steps.c.step == step)
        self.connection.execute(update(steps).where(*where).values(values))

    def _write_task(self, task: TaskRow, snapshot: TaskSnapshot) -> None:
        values: TaskRow = {
            "state": snapshot.state.value,
            "failures": snapshot.failures,
            "interruptions": snapshot.interruptions,
        }
        if snapshot.state is not TaskState.RUNNING:
            values |= {"attempt_id": None, "progress": 1.0 if snapshot.state is TaskState.SUCCEEDED else 0.0}
        task.update(values)
        self.connection.execute(update(schema.tasks).where(schema.tasks.c.id == task["id"]).values(values))

    # -- effects

    def _apply(self, effect: machine.Effect, task: TaskRow | None) -> None:
        match effect:
            case machine.FreeDependents():
                self._free_dependents(_required_task(task)["id"])
            case machine.BackOff(failures):
                wait_s = self._policy.retry_delay_s * 2.0 ** (failures - 1)
                self.delay(_required_task(task), min(wait_s, LONGEST_WAIT_S))
            case machine.CancelTasks():
                self._end_running()
            case machine.RestartTasks():
                self._restart_tasks()
            case machine.SetError(fault):
                self._set(error=self.row["error"] or fault_to_json(fault))
            case machine.ClearError():
                self._set(error=None)
            case machine.AnnounceState(run):
                self._announce(run)

    def delay(self, task: TaskRow, seconds: float) -> None:
        """The task cannot be claimed for `seconds`."""
        where = schema.tasks.c.id == task["id"]
        self.connection.execute(update(schema.tasks).where(where).values(ready_at=self.now + seconds))

    def _free_dependents(self, task_id: str) -> None:
        tasks, edges = schema.tasks, schema.task_edges
        dependents = tasks.c.id.in_(select(edges.c.task_id).where(edges.c.before_id == task_id))
        self.connection.execute(update(tasks).where(dependents).values(blockers=tasks.c.blockers - 1))
        freed = (dependents, tasks.c.blockers == 0, tasks.c.state == TaskState.WAITING.value)
        self.connection.execute(update(tasks).where(*freed).values(state=TaskState.READY.value))

    def _end_running(self) -> None:
        """End running attempts. Tasks that have not begun count as cancelled because their job is (see `task_states`):
        writing a hundred thousand rows would take seconds."""
        attempts = schema.attempts
        running = (attempts.c.job_id == self.job_id, attempts.c.outcome == RUNNING)
        ended = {"outcome": "cancelled", "finished_at": self.now}
        started = self.connection.execute(_STARTED, {"job_id": self.job_id}).scalars().all()
        if not started:
            return
        for started_at in started:
            self.charge(self.now - started_at)
        self.connection.execute(update(attempts).where(*running).values(ended))
        self._cancel_tasks(TaskState.RUNNING)

    def _cancel_tasks(self, *states: TaskState) -> None:
        tasks = schema.tasks
        where = (tasks.c.job_id == self.job_id, tasks.c.state.in_([state.value for state in states]))
        values = {"state": TaskState.CANCELLED.value, "attempt_id": None, "progress": 0.0}
        self.connection.execute(update(tasks).where(*where).values(values))

    def write_task_states(self) -> None:
        """Write the state of every task of a cancelled job, before a single one of them is run again."""
        if self.row["state"] == RunState.CANCELLED.value:
            self._cancel_tasks(*task_states.UNBEGUN)

    def _restart_tasks(self) -> None:
        tasks = schema.tasks
        ended = tasks.c.state.in_([TaskState.FAILED.value, TaskState.CANCELLED.value])
        used = or_(tasks.c.failures > 0, tasks.c.interruptions > 0, tasks.c.ready_at > 0)
        unbegun = tasks.c.state.in_([state.value for state in task_states.UNBEGUN])
        where = (tasks.c.job_id == self.job_id, or_(ended, and_(unbegun, used)))
        fresh = {"failures": 0, "interruptions": 0, "ready_at": 0.0}
        blocked = {"state": TaskState.WAITING.value, **fresh}
        free = {"state": TaskState.READY.value, **fresh}
        self.connection.execute(update(tasks).where(*where, tasks.c.blockers > 0).values(blocked))
        self.connection.execute(update(tasks).where(*where).values(free))

    def _announce(self, run: RunState) -> None:
        error = self.row["error"]
        self.add_event("job.state", {"state": run.value, "error": error})
        url = self.row["request"]["webhook"]
        if run.final and url:
            self.connection.execute(insert(schema.deliveries).values(self._message(run, url, error)))

    def _message(self, run: RunState, url: str, error: Json | None) -> Values:
        request = self.row["request"]
        data = {"job_id": self.job_id, "state": run.value, "error": error}
        data |= {name: request[name] for name in ("name", "method", "labels")}
        stamp = datetime.fromtimestamp(self.now, UTC).isoformat(timespec="milliseconds")
        body = {"type": f"job.{run.value}", "timestamp": stamp, "data": data}
        return {
            "id": new_id("msg_"),
            "job_id": self.job_id,
            "owner": self.row["owner"],
            "url": url,
            "body": body,
            "created_at": self.now,
            "state": "waiting",
            "next_at": self.now,
        }


def _task_snapshot(task: TaskRow | None) -> TaskSnapshot | None:
    if task is None:
        return None
    return TaskSnapshot(TaskState(task["state"]), task["blockers"], task["failures"], task["interruptions"])


def _all_done(before: JobSnapshot) -> Counts:
    """Counts of the step that has just been completed: all its tasks have succeeded."""
    counts = before.counts
    return Counts(succeeded=counts.open + counts.succeeded)


def _required_task(task: TaskRow | None) -> TaskRow:
    assert task is not None, "the machine asks this only for events about a task"
    return task
