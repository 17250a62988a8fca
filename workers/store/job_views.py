"""Jobs as their users see them: assembled from a page of rows with a fixed number of queries."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from sqlalchemy import BindParameter, Connection, bindparam, func, select

from workers.contract.order import CPU, PEAK_MEMORY
from workers.contract.record import Job, RunState, StepView, TaskState
from workers.store import schema
from workers.store.progress import StepMeter, job_eta_s, job_progress
from workers.store.records import AnySelect, Row, fault_of, request_of, warnings_of

ByJob = dict[str, list[Row]]

_MAY_RUN = (RunState.RUNNING.value, RunState.PAUSED.value)
"""States of jobs with attempts at work."""
_IDS: BindParameter[Any] = bindparam("ids", expanding=True)
# Built once, because building a statement takes several times as long as SQLite takes to run it.
_STEPS = select(schema.steps).where(schema.steps.c.job_id.in_(_IDS)).order_by(schema.steps.c.step)
_FILES = select(schema.files.c.job_id, schema.files.c.name).where(schema.files.c.job_id.in_(_IDS))
_RUNNING = (
    select(schema.tasks.c.job_id, schema.tasks.c.weight, schema.tasks.c.progress, schema.attempts.c.started_at)
    .join(schema.attempts, schema.attempts.c.id == schema.tasks.c.attempt_id)
    .where(schema.tasks.c.job_id.in_(_IDS), schema.tasks.c.state == TaskState.RUNNING.value)
)
_ENDED = (
    select(schema.jobs.c.id, func.count())
    .join(
        schema.attempts,
        (schema.attempts.c.job_id == schema.jobs.c.id) & (schema.attempts.c.finished_at == schema.jobs.c.updated_at),
    )
    .where(schema.jobs.c.id.in_(_IDS))
    .group_by(schema.jobs.c.id)
)
"""Number of attempts that ended with the newest change of their job."""


def job_views(connection: Connection, rows: Sequence[Row]) -> list[Job]:
    """A Job for every row of `jobs`."""
    ids = [row["id"] for row in rows]
    at_work = [row["id"] for row in rows if row["state"] in _MAY_RUN]
    steps, files = _grouped(connection, _STEPS, ids), _grouped(connection, _FILES, ids)
    running, ended = _grouped(connection, _RUNNING, at_work), _just_ended(connection, at_work)
    return [_job(row, steps[row["id"]], running[row["id"]], ended.get(row["id"], 0), files[row["id"]]) for row in rows]


def step_meters(job: Row, steps: Sequence[Row], running: Sequence[Row], ended: int, now: float) -> list[StepMeter]:
    """Measures of every step of a job.

    Args:
        running: running tasks with the start of their attempt.
        ended: number of attempts that ended with the newest change of the job, whose slots could not be filled yet.
        told_at: when they last said how far they are: seconds after that have nothing to show yet.
    """
    return [
        _meter(job, step, running, ended, now) if step["step"] == job["step"] else _meter(job, step, (), 0, now)
        for step in steps
    ]


def meters_of(connection: Connection, job: Row, now: float) -> list[StepMeter]:
    """Measures of every step of the job whose row is `job`."""
    steps, running = (_grouped(connection, query, [job["id"]])[job["id"]] for query in (_STEPS, _RUNNING))
    return step_meters(job, steps, running, 0, now)


def _just_ended(connection: Connection, ids: Sequence[str]) -> dict[str, int]:
    return {job_id: int(n) for job_id, n in connection.execute(_ENDED, {"ids": ids})} if ids else {}


def _grouped(connection: Connection, query: AnySelect, ids: Sequence[str]) -> ByJob:
    found: ByJob = defaultdict(list)
    if ids:
        for row in connection.execute(query, {"ids": ids}).mappings():
            found[row["job_id"]].append(row)
    return found


def _job(row: Row, steps: Sequence[Row], running: Sequence[Row], ended: int, files: Sequence[Row]) -> Job:
    run = RunState(row["state"])
    meters = step_meters(row, steps, running, ended, row["updated_at"])
    counts = {state.value: sum(step[state.value] for step in steps) for state in TaskState}
    return Job(
        id=row["id"],
        state=run,
        request=request_of(row["request"]),
        owner=row["owner"],
        created_at=row["created_at"],
        updated_at=row["updated_at"],
        started_at=row["started_at"],
        finished_at=row["finished_at"],
        progress=1.0 if run is RunState.SUCCEEDED else job_progress(meters),
        eta_s=job_eta_s(meters) if run is RunState.RUNNING else None,
        counts=counts,
        steps=tuple(_step(row, step, meter) for step, meter in zip(steps, meters, strict=True)),
        error=fault_of(row["error"]),
        results=tuple(sorted(file["name"] for file in files)),
        warnings=warnings_of(row["warnings"]),
    )


def _step(job: Row, step: Row, meter: StepMeter) -> StepView:
    counts = {state.value: step[state.value] for state in TaskState}
    stages = dict(step["stages"])
    return StepView(
        name=step["name"],
        title=step["title"],
        state=_step_state(job, step, meter),
        counts=counts,
        progress=meter.progress,
        seconds=stages.pop("method", 0.0),
        cpu_s=stages.pop(CPU, 0.0),
        peak_bytes=int(stages.pop(PEAK_MEMORY, 0)),
        stages=stages,
        reused=step["reused"],
    )


def _step_state(job: Row, step: Row, meter: StepMeter) -> str:
    if meter.done:
        return "succeeded"
    if step["failed"] or (step["step"] == job["step"] and job["state"] == RunState.FAILED.value):
        return "failed"
    return "running" if step["running"] or step["succeeded"] else "waiting"


def _meter(job: Row, step: Row, running: Sequence[Row], ended: int, now: float) -> StepMeter:
    return StepMeter(
        expected=step["expected"],
        weight=step["weight"],
        weight_done=step["weight_done"],
        busy_s=step["busy_s"],
        planned=job["planned"] if step["step"] == job["step"] else step["step"] < job["step"],
        done=step["step"] < job["step"] or job["state"] == RunState.SUCCEEDED.value,
        running=len(running) + min(ended, step["ready"]),
        running_weight_done=sum(task["weight"] * task["progress"] for task in running),
        running_s=sum(max(0.0, now - task["started_at"]) for task in running),
        pace_s=step["pace_s"],
    )
