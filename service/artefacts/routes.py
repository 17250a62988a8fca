"""/v1/jobs/{job_id}/artefacts/{name}: the entries of an artefact, one by one.

An artefact (GET /v1/jobs/{job_id}/files/{name}) is often a zip of a file per frame. With these routes, a page or script
lists its entries and fetches only those that it needs. The method defines the content of the entries.
"""

from __future__ import annotations

import mimetypes
import zipfile
import zlib
from dataclasses import dataclass
from typing import Annotated

from fastapi import Path, Response

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader, ServiceContext
from service.jobs.lookup import find_job
from service.prefix import Address
from service.routing import Router
from service.schemas import FileName, JobId, Listing, Responses, binary
from service.serving import CONTENT_CSP
from workers.errors import NotFound
from workers.farm_parts.stored_file import StoredFile

router = Router(prefix="/v1/jobs/{job_id}", tags=["artefacts"])

MAX_ENTRY_BYTES = 256 << 20
ZIP = "application/zip"
ENTRY: Responses = {200: binary("*/*", "The entry")[200]}

EntryName = Annotated[str, Path(max_length=512, description="An entry's `name`, as the list has it.")]


@dataclass(frozen=True)
class EntryOut:
    """An entry of an artefact."""

    name: str
    size_bytes: int
    media_type: str
    url: Address


@router.get("/artefacts/{name}")
@costs(Cost.HEAVY)
def list_entries(job_id: JobId, name: FileName, context: Context, caller: Reader) -> Listing[EntryOut]:
    """The entries of an artefact. 409 while the job has not made it yet; 404 if the artefact is not an archive."""
    served = _artefact(context, caller, job_id, name)
    with context.farm.files.local(served) as path, zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
    at = f"/v1/jobs/{job_id}/artefacts/{name}"
    return Listing(
        tuple(EntryOut(m.filename, m.file_size, _media_type(m.filename), f"{at}/{m.filename}") for m in members), None
    )


@router.get("/artefacts/{name}/{entry:path}", response_class=Response, responses=ENTRY)
@costs(Cost.HEAVY)
def get_entry(job_id: JobId, name: FileName, entry: EntryName, context: Context, caller: Reader) -> Response:
    """One entry of an artefact. Entries never change."""
    return _answer(context, _artefact(context, caller, job_id, name), entry)


def _artefact(context: ServiceContext, caller: Reader, job_id: str, name: str) -> StoredFile:
    find_job(context, caller, job_id)
    served = context.farm.files.get(job_id, name)
    if served.media_type != ZIP:
        raise NotFound(
            f"The file {name!r} is not an archive.",
            field="name",
            value=name,
            remedy=f"Download it: GET /v1/jobs/{job_id}/files/{name}.",
        )
    return served


def _answer(context: ServiceContext, served: StoredFile, entry: str) -> Response:
    etag = f'"{served.etag}-{zlib.crc32(entry.encode()):08x}"'
    headers = {
        "Cache-Control": "private, max-age=31536000, immutable",
        "Content-Security-Policy": CONTENT_CSP,
        "ETag": etag,
    }
    data = _read(context, served, entry)
    return Response(data, media_type=_media_type(entry), headers=headers)


def _read(context: ServiceContext, served: StoredFile, entry: str) -> bytes:
    with context.farm.files.local(served) as path, zipfile.ZipFile(path) as archive:
        try:
            member = archive.getinfo(entry)
        except KeyError:
            member = None
        if member is None or member.file_size > MAX_ENTRY_BYTES:
            raise NotFound(
                "Entry not found in the artefact.",
                field="entry",
                value=entry,
                remedy="List its entries: GET /v1/jobs/{job_id}/artefacts/{name}.",
            )
        return archive.read(member)


def _media_type(name: str) -> str:
    return mimetypes.guess_type(name)[0] or "application/octet-stream"
