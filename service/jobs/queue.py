"""/v1/jobs/{job_id}/queue: the number of jobs before this one, and the time that they will take."""

from __future__ import annotations

from dataclasses import dataclass

from service.access.depends import Context, Reader, ServiceContext
from service.jobs.lookup import find_job
from service.routing import Router
from service.schemas import JobId
from workers.model import Job, JobRequest, RunState
from workers.projects.estimates import SAMPLES, Estimate, estimate, parts, summed

router = Router(prefix="/v1/jobs/{job_id}", tags=["jobs"])


@dataclass(frozen=True)
class QueuePosition:
    """`jobs_ahead`: unfinished jobs of higher priority, or of equal priority and submitted earlier; `seconds`: time
    that they need one after the other; null without finished jobs for an estimate."""

    jobs_ahead: int
    seconds: float | None


@router.get("/queue")
def get_queue_position(job_id: JobId, context: Context, caller: Reader) -> QueuePosition:
    """The position of a job that has not begun; 0 for any other. Jobs of several users take turns, so that a job may
    begin earlier than the position suggests."""
    job = find_job(context, caller, job_id)
    if job.state is not RunState.QUEUED:
        return QueuePosition(0, 0.0)
    ahead = context.farm.jobs.ahead(job_id)
    seconds = [_seconds_left(context, other) for other in ahead]
    known = [found for found in seconds if found is not None]
    return QueuePosition(len(ahead), round(sum(known), 1) if len(known) == len(ahead) else None)


def _seconds_left(context: ServiceContext, job: Job) -> float | None:
    if job.eta_s is not None:
        return job.eta_s

    def one(part: JobRequest) -> Estimate:
        finished = context.farm.jobs.page(state="succeeded", method=part.method, limit=SAMPLES).items
        return estimate(part, job.owner, finished, context.farm.assets.get)

    whole = summed([one(part) for part in parts(job.request)]).seconds
    return None if whole is None else whole * (1 - job.progress)
