"""Looking up jobs and tasks that the caller may see; checks of a new job."""

from __future__ import annotations

from pipeline.errors import BadParameter
from service.access.keys import Principal
from service.assets.routes import visible
from service.context.depends import ServiceContext
from service.jobs.schemas import Work
from workers.contract.record import Job, TaskView
from workers.errors import NotFound


def find_job(context: ServiceContext, caller: Principal, job_id: str) -> Job:
    """The job. Raises NotFound, also for jobs of other owners."""
    try:
        job = context.farm.jobs.get(job_id)
    except NotFound:
        job = None
    if job is None or not caller.sees(job.owner):
        raise NotFound("Job not found.", field="job_id", value=job_id, remedy="See GET /v1/jobs for yours.")
    return job


def find_task(context: ServiceContext, caller: Principal, task_id: str) -> TaskView:
    """The task, or NotFound."""
    try:
        task = context.farm.tasks.get(task_id)
        find_job(context, caller, task.job_id)
    except NotFound:
        raise NotFound(
            "Task not found.", field="task_id", value=task_id, remedy="See GET /v1/jobs/{job_id}/tasks."
        ) from None
    return task


def check_inputs(context: ServiceContext, caller: Principal, work: Work) -> None:
    """Raise NotFound unless the caller may use every asset; BadParameter for a URL."""
    for name, asset_id in work.inputs.items():
        if "://" in asset_id:
            raise BadParameter(
                "An input is the id of an asset; URLs are not fetched.",
                field=f"inputs.{name}",
                value=asset_id,
                remedy="Upload the file (POST /v1/assets or /v1/uploads), then give its id.",
            )
        visible(context, caller, asset_id, f"inputs.{name}")


def max_active_jobs(context: ServiceContext, caller: Principal) -> int:
    """Maximum number of unfinished jobs of the caller."""
    return caller.quotas.get("active_jobs", context.settings.quota_active_jobs)


def max_reopened_jobs(context: ServiceContext, caller: Principal, owner: str) -> int | None:
    """Maximum number of unfinished jobs of `owner` when `caller` starts an ended job of theirs again; None: unlimited,
    because the caller is an operator, whose own quotas do not apply."""
    return max_active_jobs(context, caller) if caller.owner == owner else None


def parse_label(text: str | None) -> tuple[str, str] | None:
    """`name:value` as a pair. Raises BadParameter."""
    if text is None:
        return None
    name, colon, value = text.partition(":")
    if not (name and colon):
        raise BadParameter("A label filter is name:value.", field="label", value=text, remedy="For example shot:12.")
    return name, value
