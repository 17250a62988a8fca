"""/v1/ops/jobs: priorities, and one action on several jobs, for admin keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field

from pipeline.errors import ImpastoError
from service.access.admission import Cost, costs
from service.access.audit import about
from service.access.keys import Principal
from service.context.depends import Admin, Context, ServiceContext
from service.jobs.lookup import find_job, max_reopened_jobs
from service.jobs.schemas import JobOut, job_out
from service.routing import Router
from service.schemas import ID, JobId
from workers.contract.record import Fault
from workers.contract.request import MAX_PRIORITY
from workers.faults import fault_from

router = Router(prefix="/v1/ops/jobs", tags=["ops"])

MOST_JOBS = 200
Action = Literal["cancel", "pause", "resume", "retry", "delete"]


class PriorityIn(BaseModel):
    """A priority, or the front of the queue."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    priority: int | None = Field(
        default=None, ge=-MAX_PRIORITY, le=MAX_PRIORITY,
        description="Higher first; null: one above all other unfinished jobs (100 at most).",
    )  # fmt: skip


class JobsActionIn(BaseModel):
    """An action on several jobs."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    action: Action
    jobs: tuple[Annotated[str, Field(pattern=ID)], ...] = Field(min_length=1, max_length=MOST_JOBS)


@dataclass(frozen=True)
class JobActionOut:
    """Result of the action for one job."""

    job_id: str
    error: Fault | None
    """Reason why the action was refused; null if it was done."""


@dataclass(frozen=True)
class JobsActionOut:
    """One item for each job, in the order of the request."""

    items: tuple[JobActionOut, ...]


@router.post("/{job_id}/priority")
def set_priority(job_id: JobId, body: PriorityIn, context: Context, caller: Admin) -> JobOut:
    """Give an unfinished job another priority, or move it to the front. Running tasks of other jobs finish; jobs of one
    priority are served in the order of submission; several owners take turns. 409 if it has ended."""
    find_job(context, caller, job_id)
    return job_out(context.farm.jobs.prioritise(job_id, body.priority))


@router.post("/actions")
@costs(Cost.HEAVY)
def act_on_jobs(body: JobsActionIn, request: Request, context: Context, caller: Admin) -> JobsActionOut:
    """Cancel, pause, resume, retry or delete several jobs. If the action is refused for one job, it is still done for
    the others; all but retries are done in one transaction."""
    about(request, body.action, *body.jobs)
    alone = set(body.jobs) if body.action == "retry" else set()
    if body.action == "delete":
        alone = context.farm.exports.having(body.jobs)
    refused = {job_id: _attempted(context, caller, body.action, job_id) for job_id in body.jobs if job_id in alone}
    if body.action != "retry":
        together = [job_id for job_id in body.jobs if job_id not in alone]
        refused |= context.farm.jobs.command_many(together, body.action)
    return JobsActionOut(tuple(_item(job_id, refused.get(job_id)) for job_id in body.jobs))


def _item(job_id: str, error: ImpastoError | None) -> JobActionOut:
    return JobActionOut(job_id, None if error is None else fault_from(error))


def _attempted(context: ServiceContext, caller: Principal, action: Action, job_id: str) -> ImpastoError | None:
    """Retry a job, or delete it with its exports; the error if that is refused."""
    try:
        job = find_job(context, caller, job_id)
        if action == "retry":
            context.farm.jobs.retry(job_id, max_reopened_jobs(context, caller, job.owner))
        else:
            context.farm.exports.delete(job_id)
            context.farm.jobs.delete(job_id)
    except ImpastoError as error:
        return error
    return None
