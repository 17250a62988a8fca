"""/v1/jobs/{job_id}/queue: the number of jobs before this one, and the time that they will take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from service.context.depends import Context, Reader, ServiceContext
from service.jobs.lookup import find_job
from service.routing import Router
from service.schemas import JobId
from workers.contract.record import RunState
from workers.errors import NotFound
from workers.store.queue_position import MOST, MethodAhead

router = Router(prefix="/v1/jobs/{job_id}", tags=["jobs"])


@dataclass(frozen=True)
class QueuePosition:
    """`jobs_ahead`: unfinished jobs that are served before this one; `more`: there are more than this number, which are
    not counted; `seconds`: time that the counted ones need one after the other; null if it cannot be estimated."""

    jobs_ahead: int
    seconds: float | None
    more: bool = False


@router.get("/queue")
def get_queue_position(job_id: JobId, context: Context, caller: Reader) -> QueuePosition:
    """The position of a job that has not begun; 0 for any other. Before it are jobs of higher priority, your earlier
    jobs, and as many of each other owner plus one, because owners take turns. At most 1,000 jobs are counted."""
    job = find_job(context, caller, job_id)
    if job.state is not RunState.QUEUED:
        return QueuePosition(0, 0.0)
    ahead = context.farm.jobs.ahead(job_id)
    count = sum(each.jobs for each in ahead)
    return QueuePosition(min(count, MOST), _seconds(context, ahead), count > MOST)


def _seconds(context: ServiceContext, ahead: Sequence[MethodAhead]) -> float | None:
    known = [seconds for each in ahead if (seconds := _seconds_of(context, each)) is not None]
    return round(sum(known), 1) if len(known) == len(ahead) else None


def _seconds_of(context: ServiceContext, ahead: MethodAhead) -> float | None:
    """Time of all jobs of one method: the estimate of the oldest, in proportion to the weights."""
    try:
        oldest = context.farm.jobs.get(ahead.oldest)
    except NotFound:  # it has been deleted since
        return 0.0
    seconds = context.farm.jobs.estimate(oldest.request, oldest.owner).seconds
    return None if seconds is None else seconds * ahead.left
