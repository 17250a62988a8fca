"""Jobs as their users see them: assembled from a page of rows with a fixed number of queries."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, func, select

from workers.model import Job, RunState, StepView, TaskState
from workers.progress import StepMeter, job_eta_s, job_progress
from workers.store import schema
from workers.store.records import Row, fault_of, request_of

ByJob = dict[str, list[Row]]


def job_views(connection: Connection, rows: Sequence[Row]) -> list[Job]:
    """A Job for every row of `jobs`."""
    ids = [row["id"] for row in rows]
    steps = _grouped(
        connection, select(schema.steps).where(schema.steps.c.job_id.in_(ids)).order_by(schema.steps.c.step)
    )
    running, ended = _grouped(connection, _running(ids)), _just_ended(connection, ids)
    files = _grouped(
        connection, select(schema.files.c.job_id, schema.files.c.name).where(schema.files.c.job_id.in_(ids))
    )
    return [_job(row, steps[row["id"]], running[row["id"]], ended.get(row["id"], 0), files[row["id"]]) for row in rows]


def step_meters(job: Row, steps: Sequence[Row], running: Sequence[Row], ended: int, told_at: float) -> list[StepMeter]:
    """Measures of every step of a job.

    Args:
        running: its running tasks with the start of their attempt.
        ended: attempts that ended with the newest change of the job: nobody could take their place yet.
        told_at: when they last said how far they are: seconds after that have nothing to show yet.
    """
    return [
        _meter(job, step, running, ended, told_at) if step["step"] == job["step"] else _meter(job, step, (), 0, told_at)
        for step in steps
    ]


def meters_of(connection: Connection, job: Row, told_at: float) -> list[StepMeter]:
    """Measures of every step of the job whose row is `job`."""
    steps = connection.execute(
        select(schema.steps).where(schema.steps.c.job_id == job["id"]).order_by(schema.steps.c.step)
    )
    running = connection.execute(_running([job["id"]])).mappings().all()
    return step_meters(job, steps.mappings().all(), running, 0, told_at)


def _running(job_ids: Sequence[str]) -> Any:
    tasks, attempts = schema.tasks, schema.attempts
    return (
        select(tasks.c.job_id, tasks.c.weight, tasks.c.progress, attempts.c.started_at)
        .join(attempts, attempts.c.id == tasks.c.attempt_id)
        .where(tasks.c.job_id.in_(job_ids), tasks.c.state == TaskState.RUNNING.value)
    )


def _just_ended(connection: Connection, job_ids: Sequence[str]) -> dict[str, int]:
    jobs, attempts = schema.jobs, schema.attempts
    query = (
        select(jobs.c.id, func.count())
        .join(attempts, (attempts.c.job_id == jobs.c.id) & (attempts.c.finished_at == jobs.c.updated_at))
        .where(jobs.c.id.in_(job_ids))
        .group_by(jobs.c.id)
    )
    return {job_id: int(n) for job_id, n in connection.execute(query)}


def _grouped(connection: Connection, query: Any) -> ByJob:
    found: ByJob = defaultdict(list)
    for row in connection.execute(query).mappings():
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
        stages=stages,
    )


def _step_state(job: Row, step: Row, meter: StepMeter) -> str:
    if meter.done:
        return "succeeded"
    if step["failed"] or (step["step"] == job["step"] and job["state"] == RunState.FAILED.value):
        return "failed"
    return "running" if step["running"] or step["succeeded"] else "waiting"


def _meter(job: Row, step: Row, running: Sequence[Row], ended: int, told_at: float) -> StepMeter:
    return StepMeter(
        expected=step["expected"],
        weight=step["weight"],
        weight_done=step["weight_done"],
        busy_s=step["busy_s"],
        planned=job["planned"] if step["step"] == job["step"] else step["step"] < job["step"],
        done=step["step"] < job["step"] or job["state"] == RunState.SUCCEEDED.value,
        running=len(running) + min(ended, step["ready"]),
        running_weight_done=sum(task["weight"] * task["progress"] for task in running),
        running_s=sum(max(0.0, told_at - task["started_at"]) for task in running),
    )
