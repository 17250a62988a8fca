"""The regions that a job has found, frame by frame: for pages and scripts on which people design."""

from __future__ import annotations

import json
import zipfile
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Response

from service.access.depends import Parts, Reader, Service
from service.jobs.lookup import find_job
from service.schemas import JobId, Responses, binary
from workers.errors import NotFound
from workers.farm import Served

router = APIRouter(prefix="/v1/jobs/{job_id}/regions", tags=["regions"])

ARTEFACT, LIST = "regions", "regions-list.json"
PNG: Responses = {200: binary("image/png", "The map")[200]}

FrameNumber = Annotated[int, Path(ge=0, le=10_000_000, description="Which frame of the video, from 0.")]
Kind = Annotated[
    Literal["map", "tubes"],
    Query(description="map: gray, numbers of the design's regions; tubes: number = 65536 R + 256 G + B."),
]


@router.get("")
def list_regions(job_id: JobId, parts: Parts, caller: Reader) -> dict[str, Any]:
    """Every region, object and tube: colour, mean area in px, first and last frame. 409 while it is not there yet."""
    found: dict[str, Any] = json.loads(_entry(parts, _artefact(parts, caller, job_id), LIST))
    return found


@router.get("/{frame}", response_class=Response, responses=PNG)
def get_region_map(job_id: JobId, frame: FrameNumber, parts: Parts, caller: Reader, kind: Kind = "map") -> Response:
    """Where the regions, or tubes, are in a frame."""
    served = _artefact(parts, caller, job_id)
    picture = _entry(parts, served, f"{kind}-{frame:07d}.png")
    headers = {"Cache-Control": "private, max-age=31536000, immutable", "ETag": f'"{served.etag}-{kind}-{frame}"'}
    return Response(picture, media_type="image/png", headers=headers)


def _artefact(parts: Service, caller: Reader, job_id: str) -> Served:
    find_job(parts, caller, job_id)
    return parts.farm.file(job_id, ARTEFACT)


def _entry(parts: Service, served: Served, name: str) -> bytes:
    with parts.farm.local(served) as path, zipfile.ZipFile(path) as archive:
        try:
            return archive.read(name)
        except KeyError:
            raise NotFound(
                "The job has found no such map.", field="frame", value=name,
                remedy="Use a frame of the video, and kind=map or kind=tubes.",
            ) from None  # fmt: skip
