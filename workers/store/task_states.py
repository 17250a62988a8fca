"""The state of a task, which may follow from the state of its job.

Tasks of a cancelled job that had not begun count as cancelled by this rule, without a write to their rows, so that
cancelling a job takes the same time for any number of tasks. All code that reads states of tasks uses this module.
"""

from __future__ import annotations

from sqlalchemy import ColumnElement, case

from workers.contract.record import RunState, TaskState
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
