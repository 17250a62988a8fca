"""The files of a job: its result, poster, contact sheet, newest preview, and the method's artefacts."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import APIRouter, Request, Response

from service.access.depends import Parts, Reader, Service
from service.jobs.lookup import find_job
from service.jobs.schemas import FileOut
from service.schemas import Download, FileName, JobId, Listing, binary
from service.serving import serve
from workers.errors import Conflict, NotFound
from workers.model import Job

router = APIRouter(prefix="/v1/jobs/{job_id}", tags=["files"])

PLAIN = {
    "result": ("video/mp4", "The finished video"),
    "poster": ("image/jpeg", "One picture of it"),
    "sheet": ("image/jpeg", "A contact sheet"),
    "preview": ("image/jpeg", "The newest finished frame"),
}
"""Files with an address of their own, with the usual media type."""


@router.get("/files")
def list_files(job_id: JobId, parts: Parts, caller: Reader) -> Listing[FileOut]:
    """What can be had of the job now."""
    return Listing(tuple(_files(parts, find_job(parts, caller, job_id))), None)


def _files(parts: Service, job: Job) -> Iterator[FileOut]:
    for name in job.results:
        try:
            served = parts.farm.file(job.id, name)
        except (NotFound, Conflict):  # gone, or not there yet: between two looks
            continue
        url = f"/v1/jobs/{job.id}/files/{name}"
        yield FileOut(name, served.size_bytes, served.media_type, served.filename, served.etag, url)


@router.head("/files/{name}", include_in_schema=False)
@router.get("/files/{name}", response_class=Response, responses=binary("*/*", "The file"))
def get_file(
    job_id: JobId, name: FileName, request: Request, parts: Parts, caller: Reader, download: Download = False
) -> Response:
    """A file, whole or a range. 409 while it is not there yet."""
    find_job(parts, caller, job_id)
    return serve(parts.farm, parts.farm.file(job_id, name), request, download)


def _add_plain(name: str, media_type: str, text: str) -> None:
    def get(job_id: JobId, request: Request, parts: Parts, caller: Reader, download: Download = False) -> Response:
        return get_file(job_id, name, request, parts, caller, download)

    get.__name__ = f"get_{name}"
    answers = binary(media_type, text)
    more = f"{text}, whole or a range. 409 while it is not there yet."
    router.add_api_route(f"/{name}", get, response_class=Response, responses=answers, summary=text, description=more)
    router.add_api_route(f"/{name}", get, methods=["HEAD"], response_class=Response, include_in_schema=False)


for _name, (_media_type, _text) in PLAIN.items():
    _add_plain(_name, _media_type, _text)
