"""The files of a job: its result, poster, contact sheet, newest preview, and the method's artefacts."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import Request, Response

from service.context.depends import Context, Reader, ServiceContext
from service.jobs.lookup import find_job
from service.jobs.schemas import FileOut
from service.routing import Router
from service.schemas import Download, FileName, JobId, Listing, binary
from service.serving import serve
from workers.contract.record import Job
from workers.errors import Conflict, NotFound

router = Router(prefix="/v1/jobs/{job_id}", tags=["files"])

PLAIN = {
    "result": ("video/mp4", "The finished video"),
    "poster": ("image/jpeg", "One picture of it"),
    "sheet": ("image/jpeg", "A contact sheet"),
    "preview": ("image/jpeg", "The newest finished frame"),
}
"""Files with a separate address, with their usual media types."""


@router.get("/files")
def list_files(job_id: JobId, context: Context, caller: Reader) -> Listing[FileOut]:
    """Files of the job that exist now."""
    return Listing(tuple(_files(context, find_job(context, caller, job_id))), None)


def _files(context: ServiceContext, job: Job) -> Iterator[FileOut]:
    for name in job.results:
        try:
            served = context.farm.files.get(job.id, name)
        except (NotFound, Conflict):  # deleted, or restarted, since the job was read
            continue
        url = f"/v1/jobs/{job.id}/files/{name}"
        yield FileOut(name, served.size_bytes, served.media_type, served.filename, served.etag, url)


@router.head("/files/{name}", include_in_schema=False)
@router.get("/files/{name}", response_class=Response, responses=binary("*/*", "The file"))
def get_file(
    job_id: JobId, name: FileName, request: Request, context: Context, caller: Reader, download: Download = False
) -> Response:
    """A file, whole or a range. 409 until it exists."""
    find_job(context, caller, job_id)
    return serve(context, context.farm.files.get(job_id, name), request, download)


def _add_plain(name: str, media_type: str, text: str) -> None:
    def get(job_id: JobId, request: Request, context: Context, caller: Reader, download: Download = False) -> Response:
        return get_file(job_id, name, request, context, caller, download)

    get.__name__ = f"get_{name}"
    answers = binary(media_type, text)
    more = f"{text}, whole or a range. 409 while it is not there yet."
    router.add_api_route(f"/{name}", get, response_class=Response, responses=answers, summary=text, description=more)
    router.add_api_route(f"/{name}", get, methods=["HEAD"], response_class=Response, include_in_schema=False)


for _name, (_media_type, _text) in PLAIN.items():
    _add_plain(_name, _media_type, _text)
