"""Checks of the database's invariants, cheap enough for production: one read-only snapshot, indexed queries, bounds.

The checks read running attempts, unfinished jobs (at most 1000) and the newest finished ones (at most 200). Tasks are
counted and compared one by one only for jobs of up to 20 000 tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from sqlalchemy import Connection, bindparam, func, or_, select, text

from workers.contract.record import RunState, TaskState
from workers.operator_views import Violation
from workers.store import schema, state_counts, task_states
from workers.store.base import StorePart
from workers.store.job_transaction import ACTIVE, RUNNING

MAX_UNFINISHED, MAX_FINISHED = 1000, 200
MAX_TASKS = 20_000
"""Jobs with more tasks are not checked task by task."""
GRACE_S = 60.0
"""Time after the end of a lease within which other dispatchers may not have noticed it, seconds."""
_FINAL = [state.value for state in RunState if state.final]
_IDS: Any = bindparam("ids", expanding=True)
Found = Iterator[tuple[str, str]]
"""Id of the row, and a description of the violation."""


class Validation(StorePart):
    """Read-only."""

    def validate_state(self, limit: int = 100) -> list[Violation]:
        """Violated invariants of the database, empty if there are none.

        Args:
            limit: maximum number of violations of each kind.
        """
        with self._db.snapshot() as connection:
            jobs = _jobs(connection)
            totals = _totals(connection, [job["id"] for job in jobs])
            small = [job["id"] for job in jobs if totals.get(job["id"], 0) <= MAX_TASKS]
            found: list[Violation] = []
            for kind, remedy, check in _checks(connection, jobs, small, self._now()):
                for number, (name, message) in enumerate(check()):
                    if number == limit:
                        break
                    found.append(Violation(kind, name, message, remedy))
        return found


def _jobs(connection: Connection) -> list[Any]:
    table = schema.jobs
    unfinished = select(table).where(text(schema.UNFINISHED_TEXT)).order_by(table.c.id).limit(MAX_UNFINISHED)
    newest = select(table).where(table.c.state.in_(_FINAL)).order_by(table.c.id.desc()).limit(MAX_FINISHED)
    return [*connection.execute(unfinished).mappings(), *connection.execute(newest).mappings()]


def _totals(connection: Connection, job_ids: Sequence[str]) -> dict[str, int]:
    """Number of tasks of each job."""
    steps = schema.steps
    counted = func.sum(sum(steps.c[state.value] for state in TaskState))
    query = select(steps.c.job_id, counted).where(steps.c.job_id.in_(_IDS)).group_by(steps.c.job_id)
    return {job_id: int(count) for job_id, count in connection.execute(query, {"ids": job_ids})}


def _checks(
    connection: Connection, jobs: Sequence[Any], small: Sequence[str], now: float
) -> tuple[tuple[str, str, Callable[[], Found]], ...]:
    """(kind, remedy, check) of every invariant."""
    rows = {job["id"]: job for job in jobs}
    steps = _steps(connection, list(rows))
    cancel = "Cancel the job and retry it."
    return (
        ("attempt-without-lease", "Start a worker, or restart the one that is named: it gives the attempt back.",
         lambda: _attempts_without_lease(connection, now)),
        ("attempt-not-current", "Cancel the job and retry it; restart the worker if that does not help.",
         lambda: _stray_attempts(connection)),
        ("task-without-attempt", cancel, lambda: _tasks_without_attempt(connection, list(rows))),
        ("unfinished-tasks", "Delete the job and submit it again.", lambda: _unfinished(connection, rows)),
        ("wrong-counts", cancel, lambda: _wrong_counts(connection, rows, steps, small)),
        ("wrong-ready-count", cancel, lambda: _wrong_ready(rows, steps)),
        ("stuck-job", cancel, lambda: _stuck(rows, steps)),
        ("wrong-blockers", cancel, lambda: _wrong_blockers(connection, rows, small)),
        ("wrong-times", "No action is needed: nothing depends on it.", lambda: _wrong_times(rows)),
        ("missing-message", "Tell the receiver of the webhook how the job ended.",
         lambda: _missing_messages(connection, rows)),
        ("events-ahead", cancel, lambda: _events_ahead(connection, rows)),
        ("input-without-asset", "Cancel the job, and submit it again with an asset that exists.",
         lambda: _inputs_without_asset(connection, rows)),
        ("wrong-sums", "No action is needed: statistics only.", lambda: _wrong_sums(connection)),
        ("orphan", "Delete the row: what it belonged to is gone.", lambda: _orphans(connection)),
        ("result-without-file", "Delete the job and submit it again.", lambda: _without_result(connection, rows)),
    )  # fmt: skip


def _attempts_without_lease(connection: Connection, now: float) -> Found:
    """Running attempts of dispatchers whose lease has long ended, although a live dispatcher could return them."""
    table, leases = schema.attempts, schema.dispatchers
    alive = select(leases.c.id).where(leases.c.lease_until >= now - GRACE_S)
    if connection.execute(select(leases.c.id).where(leases.c.lease_until >= now).limit(1)).first() is None:
        return
    query = select(table.c.id, table.c.dispatcher).where(
        table.c.outcome == RUNNING, table.c.dispatcher.not_in(alive), table.c.started_at < now - GRACE_S
    )
    for attempt_id, dispatcher in connection.execute(query):
        yield attempt_id, f"It runs at the worker {dispatcher}, which has no lease."


def _stray_attempts(connection: Connection) -> Found:
    """Running attempts that are not the current one of a running task of an unfinished job."""
    attempts, tasks, jobs = schema.attempts, schema.tasks, schema.jobs
    query = (
        select(attempts.c.id, tasks.c.id, tasks.c.state, tasks.c.attempt_id, jobs.c.state)
        .join(tasks, tasks.c.id == attempts.c.task_id)
        .join(jobs, jobs.c.id == attempts.c.job_id)
        .where(attempts.c.outcome == RUNNING)
    )
    for attempt_id, task_id, state, current, job_state in connection.execute(query):
        if job_state in _FINAL:
            yield attempt_id, f"It runs, and its job is {job_state}."
        elif state != TaskState.RUNNING.value or current != attempt_id:
            yield attempt_id, f"It runs, and its task {task_id} is {state} with the attempt {current}."


def _tasks_without_attempt(connection: Connection, ids: Sequence[str]) -> Found:
    tasks, attempts = schema.tasks, schema.attempts
    query = (
        select(tasks.c.id)
        .outerjoin(attempts, attempts.c.id == tasks.c.attempt_id)
        .where(tasks.c.job_id.in_(_IDS), tasks.c.state == TaskState.RUNNING.value)
        .where(or_(attempts.c.id.is_(None), attempts.c.outcome != RUNNING))
    )
    for task_id in connection.execute(query, {"ids": ids}).scalars():
        yield task_id, "It is running without an attempt that runs."


def _unfinished(connection: Connection, jobs: dict[str, Any]) -> Found:
    """Jobs that succeeded although not all of their steps did."""
    tasks = schema.tasks
    done = [job_id for job_id, job in jobs.items() if job["state"] == RunState.SUCCEEDED.value]
    unfinished = tasks.c.state != TaskState.SUCCEEDED.value
    query = select(tasks.c.job_id).where(tasks.c.job_id.in_(_IDS), unfinished).distinct()
    for job_id in connection.execute(query, {"ids": done}).scalars():
        yield job_id, "It has succeeded, and some of its tasks have not."
    for job_id in done:
        if not (jobs[job_id]["planned"] and jobs[job_id]["step"] == jobs[job_id]["step_count"] - 1):
            yield job_id, "It has succeeded before its last step."


def _steps(connection: Connection, ids: Sequence[str]) -> dict[str, list[Any]]:
    query = select(schema.steps).where(schema.steps.c.job_id.in_(_IDS)).order_by(schema.steps.c.step)
    found: dict[str, list[Any]] = {}
    for row in connection.execute(query, {"ids": ids}).mappings():
        found.setdefault(row["job_id"], []).append(row)
    return found


def _wrong_counts(
    connection: Connection, jobs: dict[str, Any], steps: dict[str, list[Any]], small: Sequence[str]
) -> Found:
    """Jobs whose counters of tasks by state differ from their tasks."""
    tasks, table = schema.tasks, schema.jobs
    state = task_states.of_task(table.c.state).label("shown")
    query = (
        select(tasks.c.job_id, state, func.count())
        .join(table, table.c.id == tasks.c.job_id)
        .where(tasks.c.job_id.in_(_IDS))
        .group_by(tasks.c.job_id, state)
    )
    real: dict[tuple[str, str], int] = {
        (job_id, name): count for job_id, name, count in connection.execute(query, {"ids": small})
    }
    for job_id in small:
        for each in TaskState:
            kept = sum(step[each.value] for step in steps.get(job_id, ()))
            if kept != (count := real.get((job_id, each.value), 0)):
                yield job_id, f"Its counters say {kept} tasks {each.value}, and there are {count}."


def _wrong_sums(connection: Connection) -> Found:
    """Sums over all jobs that differ from the unfinished jobs, which an index counts."""
    counts, jobs = state_counts.read(connection), schema.jobs
    query = select(jobs.c.state, func.count()).where(text(schema.UNFINISHED_TEXT)).group_by(jobs.c.state)
    real = {state: int(count) for state, count in connection.execute(query)}
    for state in RunState:
        if not state.final and counts[f"jobs_{state.value}"] != real.get(state.value, 0):
            kept = counts[f"jobs_{state.value}"]
            yield state.value, f"The sum says {kept} jobs {state.value}, and there are {real.get(state.value, 0)}."


def _current(job: Any, steps: dict[str, list[Any]]) -> Any:
    return next((step for step in steps.get(job["id"], ()) if step["step"] == job["step"]), None)


def _wrong_ready(jobs: dict[str, Any], steps: dict[str, list[Any]]) -> Found:
    for job_id, job in jobs.items():
        step = _current(job, steps)
        may_start = job["state"] in ACTIVE and job["planned"] and not job["doomed"]
        wanted = step["ready"] if may_start and step is not None else 0
        if step is None:
            yield job_id, f"It has no step {job['step']}."
        elif job["ready"] != wanted:
            yield job_id, f"Claims see {job['ready']} ready tasks, and there are {wanted}."


def _stuck(jobs: dict[str, Any], steps: dict[str, list[Any]]) -> Found:
    """Unfinished jobs whose current step is planned but has no task that could run."""
    for job_id, job in jobs.items():
        step = _current(job, steps)
        if job["state"] in _FINAL or not job["planned"] or step is None:
            continue
        if not (step["ready"] or step["running"]) or (job["doomed"] and not step["running"]):
            yield job_id, f"It is {job['state']}, and its step {step['name']!r} has no task that could run."


def _wrong_blockers(connection: Connection, jobs: dict[str, Any], small: Sequence[str]) -> Found:
    """Tasks whose number of tasks to wait for differs from the tasks before them, or from their state."""
    tasks, edges, before = schema.tasks, schema.task_edges, schema.tasks.alias("before")
    open_before = (
        select(func.count())
        .select_from(edges.join(before, before.c.id == edges.c.before_id))
        .where(edges.c.task_id == tasks.c.id, before.c.state != TaskState.SUCCEEDED.value)
        .correlate(tasks)
        .scalar_subquery()
    )
    unfinished = [job_id for job_id in small if jobs[job_id]["state"] not in _FINAL]
    states = (TaskState.WAITING.value, TaskState.READY.value, TaskState.RUNNING.value)
    query = select(tasks.c.id, tasks.c.state, tasks.c.blockers, open_before.label("real")).where(
        tasks.c.job_id.in_(_IDS), tasks.c.state.in_(states)
    )
    for task_id, state, blockers, real in connection.execute(query, {"ids": unfinished}):
        if blockers != real:
            yield task_id, f"It waits for {blockers} tasks, and {real} before it are not done."
        elif (blockers > 0) != (state == TaskState.WAITING.value):
            yield task_id, f"It is {state}, and waits for {blockers} tasks."


def _wrong_times(jobs: dict[str, Any]) -> Found:
    for job_id, job in jobs.items():
        if (job["state"] in _FINAL) != (job["finished_at"] is not None):
            yield job_id, f"It is {job['state']}, and its end is {job['finished_at']}."


def _missing_messages(connection: Connection, jobs: dict[str, Any]) -> Found:
    """Ended jobs with a webhook and no message in the outbox."""
    hooked = [key for key, job in jobs.items() if job["state"] in _FINAL and job["request"].get("webhook")]
    query = select(schema.deliveries.c.job_id).where(schema.deliveries.c.job_id.in_(_IDS)).distinct()
    noted = set(connection.execute(query, {"ids": hooked}).scalars())
    for job_id in hooked:
        if job_id not in noted:
            yield job_id, "It has ended, and its webhook has no message."


def _events_ahead(connection: Connection, jobs: dict[str, Any]) -> Found:
    events = schema.events
    query = select(events.c.job_id, func.max(events.c.seq)).where(events.c.job_id.in_(_IDS)).group_by(events.c.job_id)
    newest = {row[0]: row[1] for row in connection.execute(query, {"ids": list(jobs)})}
    for job_id, job in jobs.items():
        if newest.get(job_id) != job["last_seq"]:
            yield job_id, f"Its newest event is {newest.get(job_id)}, and it says {job['last_seq']}."


def _inputs_without_asset(connection: Connection, jobs: dict[str, Any]) -> Found:
    inputs, assets = schema.job_inputs, schema.assets
    unfinished = [job_id for job_id, job in jobs.items() if job["state"] not in _FINAL]
    query = (
        select(inputs.c.job_id, inputs.c.name, inputs.c.asset_id)
        .outerjoin(assets, assets.c.id == inputs.c.asset_id)
        .where(inputs.c.job_id.in_(_IDS), assets.c.id.is_(None))
    )
    for job_id, name, asset_id in connection.execute(query, {"ids": unfinished}):
        yield job_id, f"The asset {asset_id} of its input {name!r} is gone."


def _orphans(connection: Connection) -> Found:
    """Rows of the outbox and running attempts whose job no longer exists; slots of workers that no longer exist."""
    jobs = select(schema.jobs.c.id)
    outbox, attempts, slots = schema.deliveries, schema.attempts, schema.slots
    waiting = select(outbox.c.id).where(outbox.c.state == "waiting", outbox.c.job_id.not_in(jobs))
    running = select(attempts.c.id).where(attempts.c.outcome == RUNNING, attempts.c.job_id.not_in(jobs))
    workers = select(slots.c.dispatcher).where(slots.c.dispatcher.not_in(select(schema.dispatchers.c.id))).distinct()
    for what, query in (("message", waiting), ("attempt", running), ("slot", workers)):
        for name in connection.execute(query).scalars():
            yield name, f"This {what} is not referenced."


def _without_result(connection: Connection, jobs: dict[str, Any]) -> Found:
    done = [job_id for job_id, job in jobs.items() if job["state"] == RunState.SUCCEEDED.value]
    query = select(schema.files.c.job_id).where(schema.files.c.job_id.in_(_IDS), schema.files.c.name == "result")
    with_result = set(connection.execute(query, {"ids": done}).scalars())
    for job_id in done:
        if job_id not in with_result:
            yield job_id, "It has succeeded without a result."
