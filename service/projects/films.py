"""/v1/projects/{project_id}/film: the film of a project, which is those of its shots in one file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Query, Request, Response

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader
from service.jobs.schemas import JobOut, job_out
from service.projects.lookup import find_project
from service.projects.schemas import ProjectId
from service.routing import Router
from service.schemas import Download, binary
from service.serving import serve
from workers.projects.films import ProjectFilm

router = Router(prefix="/v1/projects/{project_id}/film", tags=["projects"])

OfVersion = Annotated[int | None, Query(ge=1, le=2**31 - 1, description="Of the project; none: the newest.")]


@dataclass(frozen=True)
class ShotFilmOut:
    """A shot of the film. `job` paints what the shot shows, finished or in work; null: there is none."""

    shot: str
    name: str
    job: JobOut | None


@dataclass(frozen=True)
class FilmOut:
    """The film of a version. `ready`: the films of all shots are finished, so that it can be downloaded. `joined`: the
    fraction of the one file that is made, 0..1; null: nothing is to be joined. `notes`: how shots of different sizes or
    frame rates are joined."""

    version: int
    ready: bool
    shots: tuple[ShotFilmOut, ...]
    joined: float | None
    notes: tuple[str, ...]


def film_out(film: ProjectFilm) -> FilmOut:
    shots = (ShotFilmOut(one.shot, one.name, None if one.job is None else job_out(one.job)) for one in film.shots)
    return FilmOut(film.version, film.ready, tuple(shots), film.joined, film.notes)


@router.get("")
@costs(Cost.HEAVY)
def get_film(project_id: ProjectId, context: Context, caller: Reader, version: OfVersion = None) -> FilmOut:
    """The jobs that paint what the shots of a version show, in order. 422 if the version cannot be rendered."""
    find_project(context, caller, project_id)
    return film_out(context.farm.films.get(project_id, version))


@router.head("/content", include_in_schema=False)
@router.get("/content", response_class=Response, responses=binary("video/mp4", "The film"))
@costs(Cost.HEAVY)
def get_film_content(
    project_id: ProjectId,
    request: Request,
    context: Context,
    caller: Reader,
    version: OfVersion = None,
    download: Download = False,
) -> Response:
    """The film in one file with sound, whole or a range; joined when it is first asked for. 409 while the film of a
    shot is not finished, or while a join of more than 5 seconds goes on."""
    find_project(context, caller, project_id)
    return serve(context, context.farm.films.file(project_id, version), request, download)
