"""/v1/jobs: submit, list, describe, cancel, pause, resume, retry, delete."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Header, Query, Response

from service.context.depends import Context, Reader, Submitter
from service.jobs.lookup import check_inputs, find_job, max_active_jobs, max_reopened_jobs, parse_label
from service.jobs.schemas import JobIn, JobOut, job_out
from service.routing import Router
from service.schemas import Cursor, JobId, Limit, Listing
from service.webhooks.targets import check_target

router = Router(prefix="/v1/jobs", tags=["jobs"])

StateFilter = Literal["active", "queued", "running", "paused", "succeeded", "failed", "cancelled"]

IdempotencyKey = Annotated[
    str | None,
    Header(
        min_length=1,
        max_length=200,
        pattern=r"^[\x21-\x7e]+$",
        description="The same key with the same body is the same job; with another body it is refused.",
    ),
]


@router.post("", status_code=201, responses={200: {"model": JobOut, "description": "This key's job, made before"}})
def submit(
    body: JobIn,
    response: Response,
    context: Context,
    caller: Submitter,
    idempotency_key: IdempotencyKey = None,
) -> JobOut:
    """Submit a job. It is stored durably before the answer is sent."""

    def admit() -> None:
        check_inputs(context, caller, body)
        check_target(body.webhook, context.settings.webhook_private)

    limit = max_active_jobs(context, caller)
    job = context.farm.jobs.submit(body.request(), caller.owner, idempotency_key or "", admit, limit)
    response.headers["Location"] = f"/v1/jobs/{job.id}"
    response.status_code = 201 if job.new else 200
    return job_out(job)


@router.get("")
def list_jobs(
    context: Context,
    caller: Reader,
    state: Annotated[StateFilter | None, Query(description="active: queued, running or paused.")] = None,
    method: Annotated[str | None, Query(max_length=64)] = None,
    label: Annotated[str | None, Query(max_length=300, description="name:value")] = None,
    search: Annotated[
        str | None,
        Query(
            max_length=200,
            description="Words that name, method, owner or a label as name:value contain, or an id; a-z as A-Z.",
        ),
    ] = None,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> Listing[JobOut]:
    """Your jobs, newest first."""
    page = context.farm.jobs.page(state, method, caller.only_owner, parse_label(label), cursor, limit, search or "")
    return Listing(tuple(job_out(job) for job in page.items), page.cursor)


@router.get("/{job_id}")
def get_job(job_id: JobId, context: Context, caller: Reader) -> JobOut:
    """A job: its state, progress, ETA, steps, error and results."""
    return job_out(find_job(context, caller, job_id))


@router.delete("/{job_id}", status_code=204)
def delete_job(job_id: JobId, context: Context, caller: Submitter) -> None:
    """Delete a finished job, its files and its exports. 409 while one of them is not finished."""
    job = find_job(context, caller, job_id)
    if job.state.final:
        context.farm.exports.delete(job_id)
    context.farm.jobs.delete(job_id)


@router.post("/{job_id}/cancel")
def cancel(job_id: JobId, context: Context, caller: Submitter) -> JobOut:
    """Cancel the job. Finished tasks are kept, so that it can be retried."""
    find_job(context, caller, job_id)
    return job_out(context.farm.jobs.cancel(job_id))


@router.post("/{job_id}/pause")
def pause(job_id: JobId, context: Context, caller: Submitter) -> JobOut:
    """Pause the job: no further task starts, running tasks finish."""
    find_job(context, caller, job_id)
    return job_out(context.farm.jobs.pause(job_id))


@router.post("/{job_id}/resume")
def resume(job_id: JobId, context: Context, caller: Submitter) -> JobOut:
    """Resume a paused job."""
    find_job(context, caller, job_id)
    return job_out(context.farm.jobs.resume(job_id))


@router.post("/{job_id}/retry")
def retry(job_id: JobId, context: Context, caller: Submitter) -> JobOut:
    """Run the failed and cancelled tasks again."""
    owner = find_job(context, caller, job_id).owner
    return job_out(context.farm.jobs.retry(job_id, max_reopened_jobs(context, caller, owner)))
