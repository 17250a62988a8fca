"""/v1/projects/{project_id}/jobs: render the project's shots."""

from __future__ import annotations

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader, Submitter
from service.jobs.lookup import max_active_jobs
from service.jobs.routes import IdempotencyKey
from service.projects.lookup import find_project
from service.projects.schemas import ProjectId, ProjectJobOut, ProjectJobsIn, project_job_out
from service.routing import Router
from service.schemas import Listing
from workers.contract.project import ProjectJob

router = Router(prefix="/v1/projects/{project_id}/jobs", tags=["projects"])


@router.post("", status_code=201)
@costs(Cost.HEAVY)
def submit_project(
    project_id: ProjectId,
    body: ProjectJobsIn,
    context: Context,
    caller: Submitter,
    idempotency_key: IdempotencyKey = None,
) -> Listing[ProjectJobOut]:
    """Submit a job for each selected shot or variant. With `changed`, the answer has the jobs that exist already, too.
    422 with all problems if one of them cannot be rendered."""
    find_project(context, caller, project_id)
    made = context.farm.projects.submit(
        project_id,
        body.selection(),
        body.version,
        idempotency_key or "",
        max_active_jobs(context, caller),
        body.changed,
    )
    items = [
        project_job_out(ProjectJob(one.job.id, one.shot, one.variant, one.version, one.job.created_at), one.job)
        for one in made
    ]
    return Listing(tuple(items), None)


@router.get("")
def list_project_jobs(project_id: ProjectId, context: Context, caller: Reader) -> Listing[ProjectJobOut]:
    """The project's jobs, newest first."""
    find_project(context, caller, project_id)
    return Listing(tuple(project_job_out(*found) for found in context.farm.projects.jobs(project_id)), None)
