"""The state of a task, as far as its job decides it.

A cancelled job's tasks that had not begun are cancelled with it, by this rule and not by a row for each: to cancel a
job of a hundred thousand tasks takes as long as one of ten. All that reads the states of tasks asks here.
"""

from __future__ import annotations

from sqlalchemy import ColumnElement, case

from workers.model import RunState, TaskState
from workers.store import schema

UNBEGUN = (TaskState.WAITING, TaskState.READY)


def of_task(job_state: ColumnElement[str]) -> ColumnElement[str]:
    """The state of a row of `tasks` whose job is in `job_state` (a column)."""
    tasks = schema.tasks
    follows = (job_state == RunState.CANCELLED.value) & tasks.c.state.in_([state.value for state in UNBEGUN])
    return case((follows, TaskState.CANCELLED.value), else_=tasks.c.state)


def stored_as(wanted: TaskState, job: RunState) -> tuple[TaskState, ...]:
    """Stored states of tasks that count as `wanted` in a job of state `job`: none, one, or several."""
    if job is not RunState.CANCELLED:
        return (wanted,)
    if wanted is TaskState.CANCELLED:
        return (TaskState.CANCELLED, *UNBEGUN)
    return () if wanted in UNBEGUN else (wanted,)
