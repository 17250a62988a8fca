"""Plans in the database: selects the next step, and stores its tasks once."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import groupby, zip_longest
from typing import Any

from sqlalchemy import Connection, and_, bindparam, func, insert, select, text, update

from pipeline.methods.base import Task
from workers.contract.record import Fault, JobWarning, RunState, TaskState
from workers.contract.request import JobRequest, Json
from workers.ids import new_id
from workers.jobs import state_machine as machine
from workers.store import fair_scheduler, schema
from workers.store.accepted_job import Accepted
from workers.store.base import StorePart
from workers.store.job_transaction import JobTransaction
from workers.store.records import Row, request_of

# Built once, because building a statement takes longer than running it.
_TO_PLAN = (
    select(schema.jobs)
    .where(text(schema.ACTIVE_TEXT), ~schema.jobs.c.planned)
    .where(schema.jobs.c.priority == bindparam("priority"), schema.jobs.c.owner == bindparam("owner"))
    .order_by(schema.jobs.c.id)
    .limit(bindparam("most"))
)


@dataclass(frozen=True)
class StepToPlan:
    """A current step that has no tasks yet."""

    job_id: str
    step: int
    steps: int
    method: str
    params: Json
    stored_request: Json
    versions: Sequence[tuple[str, int]] = ()
    """(Name, version) of each step as the job was planned: see `workers.jobs.plan_versions`."""
    planned: bool = False
    """Whether it has tasks after all, which another version has planned."""
    planned_by: str = ""
    """Version of the program that has planned it; empty: one before versions."""

    @property
    def request(self) -> JobRequest:
        """Parsed on access, so that an unreadable request affects only its own job."""
        return request_of(self.stored_request)


class Plans(StorePart):
    """Every method is one transaction."""

    _last_owner = ""
    """Owner whose step was returned last by `to_plan`; the next call begins after it."""

    def to_plan(self, limit: int = 4, skipped: Collection[str] = ()) -> list[StepToPlan]:
        """Steps to be planned now, most urgent jobs first; of equal ones, one of each owner in turn, so that nobody
        waits for the plans of another owner's thousand jobs.

        Args:
            skipped: ids of jobs that are passed over.
        """
        found: list[Row] = []
        with self._db.read() as connection:
            lanes = fair_scheduler.unplanned_lanes(connection, self._last_owner, limit)
            for _, equal in groupby(lanes, key=lambda lane: lane[0]):
                queues = [_oldest_of(connection, lane, limit, skipped) for lane in equal]
                found += [row for turn in zip_longest(*queues) for row in turn if row is not None]
        turns = found[:limit]
        self._last_owner = turns[-1]["owner"] if turns else ""
        return [_step_to_plan(row) for row in turns]

    def planned(self, job_id: str, step: int, tasks: Sequence[Task]) -> bool:
        """Store the tasks of a step; False if another process has, or the job has ended since. `tasks` have been
        checked."""
        with self._unplanned(job_id, step) as job:
            if job is None:
                return False
            rows = _task_rows(job, step, tasks)
            waiting = sum(1 for row in rows if row["blockers"])
            _insert_tasks(job, step, tasks, rows)
            _weigh(job, step, sum(task.weight for task in tasks))
            job.apply(machine.Planned(len(rows) - waiting, waiting))
            job.add_event("step.planned", {"step": job.step_row(step)["name"], "tasks": len(rows)})
            return True

    def find(self, job_id: str) -> StepToPlan | None:
        """The current step of a job, which may be planned; None if there is no such job."""
        with self._db.read() as connection:
            row = connection.execute(select(schema.jobs).where(schema.jobs.c.id == job_id)).mappings().first()
        return None if row is None else _step_to_plan(row)

    def replan(self, seen: StepToPlan, step: int, accepted: Accepted, warning: JobWarning | None) -> bool:
        """Go back to `step` of a job that another version has planned, with this program's parameters and steps; False
        if the job has changed since it was `seen`, or tasks of it run.

        Args:
            step: first step that is planned again; the number of steps: none, only the versions are taken over.
            warning: tells the job's user; None: nothing is lost.
        """
        with self._transaction_if_any(seen.job_id) as job:
            if job is None or (job.row["versions"] or []) != seen.versions or not job.replan(step, accepted):
                return False
            if warning is not None:
                job.add_event("job.replanned", {"step": accepted.steps[step][0], "message": warning.message})
                job.add_warnings([warning])
            return True

    def announce_waiting(self, job_id: str, message: str) -> None:
        """Add an event to a job that waits for another program."""
        with self._transaction_if_any(job_id) as job:
            if job is not None:
                job.add_event("job.waits", {"message": message})

    def plan_failed(self, job_id: str, step: int, fault: Fault) -> bool:
        with self._unplanned(job_id, step) as job:
            if job is None:
                return False
            job.apply(machine.PlanFailed(fault))
            return True

    @contextmanager
    def _unplanned(self, job_id: str, step: int) -> Iterator[JobTransaction | None]:
        """The job, if `step` is its current one and still has no tasks."""
        with self._transaction_if_any(job_id) as job:
            row = {} if job is None else job.row
            is_next = bool(row) and row["step"] == step and not row["planned"] and not RunState(row["state"]).final
            yield job if is_next else None


def _oldest_of(connection: Connection, lane: tuple[int, str], most: int, skipped: Collection[str]) -> Sequence[Row]:
    query = _TO_PLAN.where(schema.jobs.c.id.not_in(list(skipped))) if skipped else _TO_PLAN
    values = {"priority": lane[0], "owner": lane[1], "most": most}
    return connection.execute(query, values).mappings().all()


def _step_to_plan(row: Any) -> StepToPlan:
    return StepToPlan(
        row["id"], row["step"], row["step_count"], row["method"], row["params"], row["request"], row["versions"] or [],
        row["planned"], row["planned_by"],
    )  # fmt: skip


def _task_rows(job: JobTransaction, step: int, tasks: Sequence[Task]) -> list[dict[str, Any]]:
    table = schema.tasks
    last = job.connection.execute(
        select(func.coalesce(func.max(table.c.position), 0)).where(table.c.job_id == job.job_id)
    ).scalar_one()
    return [_task_row(job.job_id, step, last + i, task) for i, task in enumerate(tasks, 1)]


def _task_row(job_id: str, step: int, position: int, task: Task) -> dict[str, Any]:
    start, stop = task.emits or (None, None)
    blockers = sum(1 for name in set(task.after) if "/" not in name)  # tasks of earlier steps are done
    return {
        "id": new_id("tsk_"),
        "job_id": job_id,
        "step": step,
        "position": position,
        "key": task.key,
        "args": task.args,
        "emit_start": start,
        "emit_stop": stop,
        "weight": task.weight,
        "chained": bool(task.after),
        "needs": None if task.resources is None else asdict(task.resources),
        "state": (TaskState.WAITING if blockers else TaskState.READY).value,
        "blockers": blockers,
    }


def _insert_tasks(job: JobTransaction, step: int, tasks: Sequence[Task], rows: list[dict[str, Any]]) -> None:
    names = sorted({name for task in tasks for name in task.after})
    ids = {row["key"]: row["id"] for row in rows} | _ids_of_earlier(job, step, [name for name in names if "/" in name])
    edges = [{"before_id": ids[name], "task_id": ids[task.key]} for task in tasks for name in sorted(set(task.after))]
    if rows:
        job.connection.execute(insert(schema.tasks), rows)
    if edges:
        job.connection.execute(insert(schema.task_edges), edges)


def _ids_of_earlier(job: JobTransaction, step: int, names: Sequence[str]) -> dict[str, str]:
    """Ids of tasks of earlier steps by their name, "step/key"."""
    if not names:
        return {}
    tasks, steps = schema.tasks, schema.steps
    query = (
        select(steps.c.name, tasks.c.key, tasks.c.id)
        .join(steps, and_(steps.c.job_id == tasks.c.job_id, steps.c.step == tasks.c.step))
        .where(tasks.c.job_id == job.job_id, tasks.c.step < step)
        .where(steps.c.name.in_({name.partition("/")[0] for name in names}))
    )
    wanted = set(names)
    found = {f"{name}/{key}": task_id for name, key, task_id in job.connection.execute(query)}
    return {name: task_id for name, task_id in found.items() if name in wanted}


def _weigh(job: JobTransaction, step: int, weight: float) -> None:
    steps = schema.steps
    where = (steps.c.job_id == job.job_id, steps.c.step == step)
    job.connection.execute(update(steps).where(*where).values(weight=weight))
