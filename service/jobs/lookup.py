"""Jobs and tasks as their owner may see them, and what a new job must pass."""

from __future__ import annotations

from pipeline.errors import BadParameter
from service.access.depends import Service
from service.access.keys import Principal
from service.assets.routes import visible
from service.jobs.schemas import Work
from workers.errors import NotFound, QuotaExceeded
from workers.model import Job, TaskView


def find_job(parts: Service, caller: Principal, job_id: str) -> Job:
    """The job, or NotFound: also if it is someone else's, which is not to be told apart."""
    try:
        job = parts.farm.job(job_id)
    except NotFound:
        job = None
    if job is None or not caller.sees(job.owner):
        raise NotFound("There is no such job.", field="job_id", value=job_id, remedy="See GET /v1/jobs for yours.")
    return job


def find_task(parts: Service, caller: Principal, task_id: str) -> TaskView:
    """The task, or NotFound."""
    try:
        task = parts.farm.task(task_id)
        find_job(parts, caller, task.job_id)
    except NotFound:
        raise NotFound(
            "There is no such task.", field="task_id", value=task_id, remedy="See GET /v1/jobs/{job_id}/tasks."
        ) from None
    return task


def check_inputs(parts: Service, caller: Principal, work: Work) -> None:
    """Raise NotFound unless every asset is there for the caller."""
    for name, asset_id in work.inputs.items():
        visible(parts, caller, asset_id, f"inputs.{name}")


def check_quota(parts: Service, caller: Principal) -> None:
    """Raise QuotaExceeded if the caller has as many unfinished jobs as they may."""
    limit = caller.quotas.get("active_jobs", parts.settings.quota_active_jobs)
    if parts.farm.keys.usage(caller.owner)["active_jobs"] >= limit:
        raise QuotaExceeded(
            f"You may have {limit} unfinished jobs.",
            field="active_jobs",
            value=limit,
            remedy="Wait until one ends, or cancel one.",
        )


def parse_label(text: str | None) -> tuple[str, str] | None:
    """`name:value` as a pair. Raises BadParameter."""
    if text is None:
        return None
    name, colon, value = text.partition(":")
    if not (name and colon):
        raise BadParameter("A label filter is name:value.", field="label", value=text, remedy="For example shot:12.")
    return name, value
