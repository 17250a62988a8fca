"""/v1/jobs/{job_id}/tasks and /v1/tasks: tasks of a job, their logs, and requeueing."""

from __future__ import annotations

from service.context.depends import Context, Reader, Submitter
from service.jobs.lookup import find_job, find_task, max_reopened_jobs
from service.jobs.schemas import LogOut
from service.routing import Router
from service.schemas import Cursor, JobId, Limit, Listing, TaskId
from workers.contract.record import TaskState, TaskView

router = Router(prefix="/v1", tags=["tasks"])


@router.get("/jobs/{job_id}/tasks")
def list_tasks(
    job_id: JobId,
    context: Context,
    caller: Reader,
    state: TaskState | None = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Listing[TaskView]:
    """The job's tasks in plan order, each with its attempts."""
    find_job(context, caller, job_id)
    page = context.farm.tasks.page(job_id, state, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/tasks/{task_id}")
def get_task(task_id: TaskId, context: Context, caller: Reader) -> TaskView:
    """One task."""
    return find_task(context, caller, task_id)


@router.get("/tasks/{task_id}/log")
def get_log(task_id: TaskId, context: Context, caller: Reader) -> LogOut:
    """The log of the task's last attempt."""
    find_task(context, caller, task_id)
    return LogOut(task_id, context.farm.tasks.log(task_id))


@router.post("/tasks/{task_id}/requeue")
def requeue(task_id: TaskId, context: Context, caller: Submitter) -> TaskView:
    """Run a failed or cancelled task again."""
    owner = find_job(context, caller, find_task(context, caller, task_id).job_id).owner
    return context.farm.tasks.requeue(task_id, max_reopened_jobs(context, caller, owner))
