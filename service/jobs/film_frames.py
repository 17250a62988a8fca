"""/v1/jobs/{job_id}/frames/{index}: one frame of a finished film at full size, for viewing or correction."""

from __future__ import annotations

import zipfile
from typing import Annotated

from fastapi import Path, Response

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader, ServiceContext
from service.jobs.lookup import find_job
from service.routing import Router
from service.schemas import JobId, binary
from workers.errors import NotFound
from workers.farm_parts.stored_file import StoredFile

router = Router(prefix="/v1/jobs/{job_id}", tags=["files"])

ZIP = "application/zip"
Index = Annotated[int, Path(ge=0, le=10_000_000, description="Which frame of the film, from 0.")]


@router.get(
    "/frames/{index}",
    response_class=Response,
    responses=binary("image/png", "The frame"),
)
@costs(Cost.FRAMES)
def get_film_frame(job_id: JobId, index: Index, context: Context, caller: Reader) -> Response:
    """A frame of the finished film as PNG. Of a film in PNG frames these are its exact pixels, of any other the decoded
    ones. A film of a piece of the video begins with frame 0. 409 while the film is not finished; 404 beyond its end."""
    find_job(context, caller, job_id)
    film = context.farm.files.get(job_id, "result")
    data = _entry(context, film, index) if film.media_type == ZIP else _decoded(context, film, index)
    return Response(data, media_type="image/png", headers={"Cache-Control": "private, max-age=3600"})


def _entry(context: ServiceContext, film: StoredFile, index: int) -> bytes:
    with context.farm.files.local(film) as path, zipfile.ZipFile(path) as archive:
        names = sorted(name for name in archive.namelist() if name.endswith(".png"))
        if index >= len(names):
            raise _missing(index, len(names))
        return archive.read(names[index])


def _decoded(context: ServiceContext, film: StoredFile, index: int) -> bytes:
    found = context.farm.files.frame(film, index)
    if found is None:
        raise _missing(index)
    return found


def _missing(index: int, count: int | None = None) -> NotFound:
    remedy = "Name a frame of the film." if count is None else f"Use 0 to {count - 1}."
    return NotFound("The film has no frame of this number.", field="index", value=index, remedy=remedy)
