"""/v1/jobs/{job_id}/exports: the finished film in other formats."""

from __future__ import annotations

from fastapi import Response

from service.context.depends import Context, Reader, Submitter
from service.jobs.lookup import find_job, max_active_jobs
from service.jobs.schemas import ExportIn, JobOut, job_out
from service.routing import Router
from service.schemas import JobId, Listing

router = Router(prefix="/v1/jobs/{job_id}/exports", tags=["files"])


@router.post("", status_code=201, responses={200: {"model": JobOut, "description": "The export made before"}})
def export_film(job_id: JobId, body: ExportIn, response: Response, context: Context, caller: Submitter) -> JobOut:
    """Convert the finished film, in a job whose result is the file. Another request for the same format returns the
    same job."""
    job = find_job(context, caller, job_id)
    known = {export.id for export in context.farm.exports.of(job.id)}
    made = context.farm.exports.make(job.id, body.spec(), max_active_jobs(context, caller))
    response.headers["Location"] = f"/v1/jobs/{made.id}"
    response.status_code = 200 if made.id in known else 201
    return job_out(made)


@router.get("")
def list_exports(job_id: JobId, context: Context, caller: Reader) -> Listing[JobOut]:
    """Exports of the film, newest first."""
    find_job(context, caller, job_id)
    return Listing(tuple(job_out(export) for export in context.farm.exports.of(job_id)), None)
