"""Tasks as users see them, with their attempts and logs. Read-only."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence

from sqlalchemy import ColumnElement, CompoundSelect, Connection, select, union_all

from workers.contract.record import Page, RunState, TaskState, TaskView
from workers.contract.request import Json
from workers.errors import NotFound
from workers.store import schema, task_states
from workers.store.base import StorePart
from workers.store.jobs import known_state
from workers.store.records import AnySelect, Row, pack_cursor, unpack_cursor


class Tasks(StorePart):
    """Tasks by id, and by job in plan order."""

    def page(self, job_id: str, state: str | None = None, cursor: str | None = None, limit: int = 100) -> Page:
        """TaskView items in plan order."""
        table = schema.tasks
        after = 0 if cursor is None else unpack_cursor(cursor, int)[0]
        wanted = None if state is None else TaskState(known_state(TaskState, state))
        where: list[ColumnElement[bool]]
        with self._db.read() as connection:
            job = _state(connection, job_id)
            if wanted is not None:
                where = [table.c.id.in_(_first(job_id, task_states.stored_as(wanted, job), after, limit + 1))]
            else:  # positions have no gaps, so PostgreSQL reads only a page even before it has statistics
                where = [table.c.job_id == job_id, table.c.position > after, table.c.position <= after + limit + 1]
            query = _tasks().where(*where).order_by(table.c.position).limit(limit + 1)
            rows = connection.execute(query).mappings().all()
            views = _task_views(connection, rows[:limit])
        return Page(tuple(views), pack_cursor(rows[limit - 1]["position"]) if len(rows) > limit else None)

    def get(self, task_id: str) -> TaskView:
        with self._db.read() as connection:
            rows = connection.execute(_tasks().where(schema.tasks.c.id == task_id)).mappings().all()
            if not rows:
                raise NotFound(f"There is no task {task_id}.", field="task", value=task_id)
            return _task_views(connection, rows)[0]

    def log(self, task_id: str) -> str:
        """Logs of the task's attempts, oldest first, each under a heading. Raises NotFound."""
        attempts = schema.attempts
        query = (
            select(attempts.c.number, attempts.c.outcome, attempts.c.worker, attempts.c.log)
            .where(attempts.c.task_id == task_id)
            .order_by(attempts.c.number)
        )
        self.get(task_id)
        with self._db.read() as connection:
            found = connection.execute(query).all()
        return "".join(
            f"== attempt {n}, {outcome}, {worker or '-'}\n{log.rstrip()}\n" for n, outcome, worker, log in found
        )


def _tasks() -> AnySelect:
    tasks, steps, jobs = schema.tasks, schema.steps, schema.jobs
    columns = (tasks.c.id, tasks.c.job_id, tasks.c.key, tasks.c.progress, tasks.c.position, tasks.c.reused)
    return (
        select(*columns, task_states.of_task(jobs.c.state).label("state"), steps.c.name.label("step_name"))
        .join(steps, (steps.c.job_id == tasks.c.job_id) & (steps.c.step == tasks.c.step))
        .join(jobs, jobs.c.id == tasks.c.job_id)
    )


def _first(job_id: str, stored: Collection[TaskState], after: int, limit: int) -> CompoundSelect[str] | list[str]:
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


def _task_views(connection: Connection, rows: Sequence[Row]) -> list[TaskView]:
    attempts = schema.attempts
    columns = [column for column in attempts.c if column.name != "log"]
    query = select(*columns).where(attempts.c.task_id.in_([row["id"] for row in rows])).order_by(attempts.c.number)
    by_task: dict[str, list[Json]] = defaultdict(list)
    for attempt in connection.execute(query).mappings():
        by_task[attempt["task_id"]].append(_attempt(attempt))
    return [_task_view(row, tuple(by_task[row["id"]])) for row in rows]


def _task_view(row: Row, attempts: tuple[Json, ...]) -> TaskView:
    state = TaskState(row["state"])
    return TaskView(
        row["id"], row["job_id"], row["step_name"], row["key"], state, row["progress"], attempts, row["reused"]
    )  # fmt: skip


def _attempt(row: Row) -> Json:
    shown = {name: row[name] for name in ("id", "number", "worker", "started_at", "finished_at", "outcome")}
    return {**shown, "error": row["fault"]}


def _state(connection: Connection, job_id: str) -> RunState:
    found = connection.execute(select(schema.jobs.c.state).where(schema.jobs.c.id == job_id)).scalar()
    if found is None:
        raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
    return RunState(found)
