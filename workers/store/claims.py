"""Claims a task of a locked job: begins a new attempt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from sqlalchemy import Connection, bindparam, func, insert, select, update

from pipeline.errors import ImpastoError
from workers.contract.record import TaskState
from workers.contract.request import Json
from workers.ids import new_id
from workers.jobs import state_machine as machine
from workers.store import fair_scheduler, schema
from workers.store.job_transaction import ACTIVE, RUNNING, JobTransaction
from workers.store.records import TaskRow

# Built once, because building a statement takes longer than running it.
_FIRST_READY = (
    select(schema.tasks)
    .where(schema.tasks.c.job_id == bindparam("job_id"), *fair_scheduler.due())
    .order_by(schema.tasks.c.position)
    .limit(1)
)
_MADE = select(func.coalesce(func.max(schema.attempts.c.number), 0)).where(
    schema.attempts.c.task_id == bindparam("task_id")
)


@dataclass(frozen=True)
class Claim:
    """A task that this dispatcher runs now."""

    attempt_id: str
    job_id: str
    step_name: str
    task: TaskRow
    """The row of the task."""
    job: Json
    """The row of its job."""


class OtherVersion(ImpastoError):
    """The next job has been planned by another version of the program. Tasks of other jobs may be claimed."""

    code = "other-version"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"The job {job_id} was planned by another version.", field="job", value=job_id)
        self.job_id = job_id


class ClaimFailed(ImpastoError):
    """An unexpected error (its cause) occurred when a task of the job `job_id` was claimed. Tasks of other jobs may be
    claimed."""

    code = "claim-failed"

    def __init__(self, job_id: str) -> None:
        super().__init__(f"No task of the job {job_id} can be claimed.", field="job", value=job_id)
        self.job_id = job_id


def claim_in(job: JobTransaction, dispatcher: str) -> Claim | None:
    """Claim the job's first ready task; None if the locked job has none any more."""
    task = _first_ready(job)
    if task is None or job.row["doomed"] or job.row["state"] not in ACTIVE:
        return None
    job.apply(machine.Claimed(), task)
    attempt_id, number = new_id("att_"), _next_number(job.connection, task["id"])
    attempt = {
        "id": attempt_id,
        "task_id": task["id"],
        "job_id": job.job_id,
        "number": number,
        "outcome": RUNNING,
    }
    attempt |= {"dispatcher": dispatcher, "started_at": job.now}
    job.connection.execute(insert(schema.attempts).values(attempt))
    where = schema.tasks.c.id == task["id"]
    job.connection.execute(update(schema.tasks).where(where).values(attempt_id=attempt_id))
    task["attempt_id"] = attempt_id
    job.add_task_event(task, TaskState.RUNNING, attempt=number)
    return Claim(attempt_id, job.job_id, job.step_row(task["step"])["name"], task, job.row)


def _first_ready(job: JobTransaction) -> TaskRow | None:
    row = (
        job.connection.execute(_FIRST_READY, {"job_id": job.job_id, **fair_scheduler.moment(job.now)})
        .mappings()
        .first()
    )
    return None if row is None else cast(TaskRow, dict(row))


def _next_number(connection: Connection, task_id: str) -> int:
    return int(connection.execute(_MADE, {"task_id": task_id}).scalar_one()) + 1
