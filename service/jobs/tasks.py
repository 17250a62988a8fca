"""/v1/jobs/{job_id}/tasks and /v1/tasks: the units of a job, their logs, and another try."""

from __future__ import annotations

from fastapi import APIRouter

from service.access.depends import Parts, Reader, Submitter
from service.jobs.lookup import find_job, find_task
from service.jobs.schemas import LogOut
from service.schemas import Cursor, JobId, Limit, Listing, TaskId
from workers.model import TaskState, TaskView

router = APIRouter(prefix="/v1", tags=["tasks"])


@router.get("/jobs/{job_id}/tasks")
def list_tasks(
    job_id: JobId,
    parts: Parts,
    caller: Reader,
    state: TaskState | None = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Listing[TaskView]:
    """The job's tasks in plan order, each with its attempts."""
    find_job(parts, caller, job_id)
    page = parts.farm.tasks(job_id, state, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/tasks/{task_id}")
def get_task(task_id: TaskId, parts: Parts, caller: Reader) -> TaskView:
    """One task."""
    return find_task(parts, caller, task_id)


@router.get("/tasks/{task_id}/log")
def get_log(task_id: TaskId, parts: Parts, caller: Reader) -> LogOut:
    """What the task's last attempt said."""
    find_task(parts, caller, task_id)
    return LogOut(task_id, parts.farm.task_log(task_id))


@router.post("/tasks/{task_id}/requeue")
def requeue(task_id: TaskId, parts: Parts, caller: Submitter) -> TaskView:
    """Run a failed or cancelled task again."""
    find_task(parts, caller, task_id)
    return parts.farm.requeue(task_id)
