"""POST /v1/estimates: estimates the cost of jobs before they are submitted."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field

from pipeline.methods.parts import FrameRange, Id
from service.access.admission import Cost, costs
from service.access.keys import Principal
from service.context.depends import Context, Reader, ServiceContext
from service.jobs.lookup import check_inputs
from service.jobs.schemas import JobIn
from service.projects.lookup import find_project
from service.routing import Router
from workers.contract.record import AnyOwner
from workers.contract.request import JobRequest
from workers.jobs.estimates import Estimate
from workers.projects.faults import refuse_if_any
from workers.projects.materials import Uploaded
from workers.projects.parsing import parse_document
from workers.projects.submissions import Selection, submissions

router = Router(prefix="/v1/estimates", tags=["projects"])


class EstimateIn(BaseModel):
    """A job, or shots of a project."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    request: JobIn | None = None
    project: str | None = Field(default=None, max_length=100)
    shots: tuple[Id, ...] | None = Field(default=None, max_length=500, description="None: all.")
    range: FrameRange | None = Field(default=None, description="This piece of each shot's video.")


@dataclass(frozen=True)
class ShotEstimate(Estimate):
    """The estimate of one shot's job; `shot` is empty for a plain request."""

    shot: str = ""


@dataclass(frozen=True)
class EstimatesOut:
    """`jobs_ahead`: unfinished jobs of everyone, which may run before or beside these."""

    items: tuple[ShotEstimate, ...]
    jobs_ahead: int


@router.post("")
@costs(Cost.HEAVY)
def estimate_jobs(body: EstimateIn, context: Context, caller: Reader) -> EstimatesOut:
    """Wall time, CPU time, memory and disk of jobs once they begin: from a preview of the same film with the same
    parameters, else from finished jobs of the same method on this farm, else (`samples` 0) from the method's own
    figures."""
    items = tuple(_estimate(context, *each) for each in _requests(context, caller, body))
    jobs = context.farm.jobs.by_state()
    return EstimatesOut(items, jobs["queued"] + jobs["running"])


def _requests(
    context: ServiceContext, caller: Principal, body: EstimateIn
) -> list[tuple[str, JobRequest, str | AnyOwner]]:
    """(shot, request, owner of its assets)."""
    found: list[tuple[str, JobRequest, str | AnyOwner]] = []
    if body.request is not None:
        check_inputs(context, caller, body.request)
        found.append(("", body.request.request(), caller.reach))
    if body.project is not None:
        project = find_project(context, caller, body.project)
        document = parse_document(context.farm.projects.document(project.id)[1])
        selection = Selection(body.shots, frames=body.range)
        refuse_if_any(context.farm.projects.problems(document, project.owner, selection))
        for job in submissions(document, selection):
            video = job.inputs["video"]
            assert isinstance(video, Uploaded)
            request = JobRequest(job.method, {"video": video.asset_id}, job.params, frames=job.frames)
            found.append((job.shot, request, project.owner))
    return found


def _estimate(context: ServiceContext, shot: str, request: JobRequest, owner: str | AnyOwner) -> ShotEstimate:
    return ShotEstimate(**vars(context.farm.jobs.estimate(request, owner)), shot=shot)
