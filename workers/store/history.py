"""Tasks with their attempts, logs, and the history of events: for those who look."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from typing import Any

from sqlalchemy import ColumnElement, Connection, func, select, union_all

from workers.errors import NotFound
from workers.farm import Page
from workers.model import Event, Json, RunState, TaskState, TaskView
from workers.store import schema, states
from workers.store.base import Base
from workers.store.jobs import known_state
from workers.store.records import Row, event_of, pack_cursor, unpack_cursor


class History(Base):
    """Read-only."""

    def tasks(self, job_id: str, state: str | None = None, cursor: str | None = None, limit: int = 100) -> Page:
        """TaskView items in plan order."""
        table = schema.tasks
        after = 0 if cursor is None else unpack_cursor(cursor, int)[0]
        wanted = None if state is None else TaskState(known_state(TaskState, state))
        where: list[ColumnElement[bool]]
        with self._db.read() as connection:
            job = _state(connection, job_id)
            if wanted is not None:
                where = [table.c.id.in_(_first(job_id, states.stored_as(wanted, job), after, limit + 1))]
            else:  # positions have no gaps; so PostgreSQL reads a page, and not a job, before it has statistics
                where = [table.c.job_id == job_id, table.c.position > after, table.c.position <= after + limit + 1]
            query = _tasks().where(*where).order_by(table.c.position).limit(limit + 1)
            rows = connection.execute(query).mappings().all()
            views = _task_views(connection, rows[:limit])
        return Page(tuple(views), pack_cursor(rows[limit - 1]["position"]) if len(rows) > limit else None)

    def task(self, task_id: str) -> TaskView:
        with self._db.read() as connection:
            rows = connection.execute(_tasks().where(schema.tasks.c.id == task_id)).mappings().all()
            if not rows:
                raise NotFound(f"There is no task {task_id}.", field="task", value=task_id)
            return _task_views(connection, rows)[0]

    def log(self, task_id: str) -> str:
        """Logs of the task's attempts, oldest first, each under a heading."""
        attempts = schema.attempts
        query = (
            select(attempts.c.number, attempts.c.outcome, attempts.c.worker, attempts.c.log)
            .where(attempts.c.task_id == task_id)
            .order_by(attempts.c.number)
        )
        self.task(task_id)
        with self._db.read() as connection:
            found = connection.execute(query).all()
        return "".join(
            f"== attempt {n}, {outcome}, {worker or '-'}\n{log.rstrip()}\n" for n, outcome, worker, log in found
        )

    def events(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[list[Event], bool]:
        """Events with seq > `after`, and whether some of those asked for are gone."""
        table = schema.events
        query = select(table).where(table.c.job_id == job_id, table.c.seq > after).order_by(table.c.seq).limit(limit)
        with self._db.read() as connection:
            newest = _newest_seq(connection, job_id)
            found = [event_of(row) for row in connection.execute(query).mappings()]
        first = found[0].seq if found else newest + 1
        return found, first > after + 1 and newest > after

    def wait(self, job_id: str, after: int, timeout_s: float) -> bool:
        """Block until the job has an event with seq > `after` (or is deleted: True as well); False on time-out."""
        if not self._bell.newest(job_id):
            with self._db.read() as connection:
                self._bell.ring(job_id, _newest_seq(connection, job_id))
        return self._bell.wait(job_id, after, timeout_s, self._newest)

    def _newest(self, job_ids: Collection[str]) -> dict[str, int]:
        jobs = schema.jobs
        with self._db.read() as connection:
            found = connection.execute(select(jobs.c.id, jobs.c.last_seq).where(jobs.c.id.in_(job_ids)))
            return {job_id: int(seq) for job_id, seq in found}


def _tasks() -> Any:
    tasks, steps, jobs = schema.tasks, schema.steps, schema.jobs
    columns = (tasks.c.id, tasks.c.job_id, tasks.c.key, tasks.c.progress, tasks.c.position)
    return (
        select(*columns, states.of_task(jobs.c.state).label("state"), steps.c.name.label("step_name"))
        .join(steps, (steps.c.job_id == tasks.c.job_id) & (steps.c.step == tasks.c.step))
        .join(jobs, jobs.c.id == tasks.c.job_id)
    )


def _first(job_id: str, stored: Collection[TaskState], after: int, limit: int) -> Any:
    """Ids of the first tasks of each of these states: by the index of states, however many there are."""
    table = schema.tasks
    each = [
        select(table.c.id)
        .where(table.c.job_id == job_id, table.c.state == state.value, table.c.position > after)
        .order_by(table.c.position)
        .limit(limit)
        .subquery()
        for state in stored
    ]
    return union_all(*(select(one.c.id) for one in each)) if each else []


def _task_views(connection: Connection, rows: Any) -> list[TaskView]:
    attempts = schema.attempts
    columns = [column for column in attempts.c if column.name != "log"]
    query = select(*columns).where(attempts.c.task_id.in_([row["id"] for row in rows])).order_by(attempts.c.number)
    by_task: dict[str, list[Json]] = defaultdict(list)
    for attempt in connection.execute(query).mappings():
        by_task[attempt["task_id"]].append(_attempt(attempt))
    return [_task_view(row, tuple(by_task[row["id"]])) for row in rows]


def _task_view(row: Row, attempts: tuple[Json, ...]) -> TaskView:
    state = TaskState(row["state"])
    return TaskView(row["id"], row["job_id"], row["step_name"], row["key"], state, row["progress"], attempts)


def _attempt(row: Row) -> Json:
    shown = {name: row[name] for name in ("id", "number", "worker", "started_at", "finished_at", "outcome")}
    return {**shown, "error": row["fault"]}


def _state(connection: Connection, job_id: str) -> RunState:
    found = connection.execute(select(schema.jobs.c.state).where(schema.jobs.c.id == job_id)).scalar()
    if found is None:
        raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
    return RunState(found)


def _newest_seq(connection: Connection, job_id: str) -> int:
    query = select(func.max(schema.jobs.c.last_seq)).where(schema.jobs.c.id == job_id)
    seq = connection.execute(query).scalar()
    if seq is None:
        raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
    return int(seq)
