"""Shared links: read-only access to one project for anyone who has the link, until it expires."""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import Path, Request, Response

from service.access.admission import Cost, costs
from service.access.keys import OPERATOR, Principal
from service.context.depends import Context, ServiceContext, Sharer, Submitter
from service.errors import Forbidden, Gone
from service.projects.comments import write_comment
from service.projects.lookup import find_project
from service.projects.schemas import (
    CommentIn,
    ProjectId,
    ProjectJobOut,
    ProjectOut,
    SharedFilmOut,
    ShareIn,
    ShareOut,
    project_job_out,
    project_out,
)
from service.projects.tokens import Claims, fingerprint, sign, verify
from service.routing import Router
from service.schemas import AssetId, Download, JobId, Listing, binary
from service.serving import serve
from workers.contract.project import Comment, Project
from workers.errors import Conflict, NotFound

router = Router(tags=["projects"])

_USER = "user:"
"""Before the id of a user in a token."""
Token = Annotated[str, Path(max_length=1000, description="As the link has it.")]


@router.post("/v1/projects/{project_id}/share", status_code=201)
def share_project(project_id: ProjectId, body: ShareIn, context: Context, caller: Sharer) -> ShareOut:
    """Make a link that shows the project, its jobs and results to anyone who has it, without a key. It ends with its
    time, with the project, with `DELETE .../share`, and with the key that made it. Needs the scopes submit and read."""
    find_project(context, caller, project_id)
    expires_at = int(time.time() + body.days * 86400)
    epoch = context.farm.projects.share_epoch(project_id)
    claims = Claims(project_id, _sharing_key(context, caller), epoch, expires_at, body.comments)
    token = sign(claims, context.webhook_secrets.master())
    return ShareOut(token, f"/shared/{token}", float(expires_at))


@router.delete("/v1/projects/{project_id}/share", status_code=204)
def end_shares(project_id: ProjectId, context: Context, caller: Submitter) -> None:
    """End every link of the project."""
    find_project(context, caller, project_id)
    context.farm.projects.end_shares(project_id)


@router.get("/v1/shared/{token}")
@costs(Cost.HEAVY)
def get_shared(token: Token, context: Context) -> ProjectOut:
    """The project of a link, with its document."""
    project = _shared(context, token)
    _, document = context.farm.projects.document(project.id)
    return project_out(project, document)


@router.get("/v1/shared/{token}/jobs")
def list_shared_jobs(token: Token, context: Context) -> Listing[ProjectJobOut]:
    """Jobs of the shared project, newest first."""
    project = _shared(context, token)
    return Listing(tuple(project_job_out(*found) for found in context.farm.projects.jobs(project.id)), None)


@router.head("/v1/shared/{token}/assets/{asset_id}/content", include_in_schema=False)
@router.get(
    "/v1/shared/{token}/assets/{asset_id}/content", response_class=Response, responses=binary("*/*", "The bytes")
)
def get_shared_asset(token: Token, asset_id: AssetId, request: Request, context: Context) -> Response:
    """An asset that the shared document names, whole or a range."""
    project = _shared(context, token)
    _, document = context.farm.projects.document(project.id)
    if asset_id not in {ref["id"] for ref in document.get("assets", {}).values()}:
        raise NotFound("Asset not found in the project.", field="asset_id", value=asset_id)
    return serve(context, context.farm.assets.file(asset_id, project.owner), request)


@router.head("/v1/shared/{token}/jobs/{job_id}/result", include_in_schema=False)
@router.get(
    "/v1/shared/{token}/jobs/{job_id}/result", response_class=Response, responses=binary("video/mp4", "The film")
)
def get_shared_result(token: Token, job_id: JobId, request: Request, context: Context) -> Response:
    """The result of one of the shared project's jobs, whole or a range."""
    project = _shared(context, token)
    if job_id not in {noted.job_id for noted, _ in context.farm.projects.jobs(project.id)}:
        raise NotFound("Job not found in the project.", field="job_id", value=job_id)
    return serve(context, context.farm.files.get(job_id, "result"), request)


@router.get("/v1/shared/{token}/film")
@costs(Cost.HEAVY)
def get_shared_film(token: Token, context: Context) -> SharedFilmOut:
    """The newest film of all shots that is finished, with its shots as chapters; `version` null: there is none."""
    project, claims = _opened(context, token)
    film = context.farm.films.newest(project.id)
    if film is None:
        return SharedFilmOut(None, False, None, (), claims.comments)
    return SharedFilmOut(film.version, film.ready, film.joined, film.chapters, claims.comments)


@router.head("/v1/shared/{token}/film/content", include_in_schema=False)
@router.get("/v1/shared/{token}/film/content", response_class=Response, responses=binary("video/mp4", "The film"))
@costs(Cost.HEAVY)
def get_shared_film_content(token: Token, request: Request, context: Context, download: Download = False) -> Response:
    """That film in one file with sound, whole or a range. 409 while it is being joined, or if there is none."""
    project = _shared(context, token)
    film = context.farm.films.newest(project.id)
    if film is None:
        raise Conflict(
            "No film of all shots is finished.", field="token", remedy="Ask the project's owner to paint it."
        )
    return serve(context, context.farm.films.file(project.id, film.version), request, download)


@router.get("/v1/shared/{token}/comments")
def list_shared_comments(token: Token, context: Context) -> Listing[Comment]:
    """Comments on the shared project, if its link allows comments."""
    project, claims = _opened(context, token)
    _check_comments(claims)
    return Listing(tuple(context.farm.comments.of(project.id)), None)


@router.post("/v1/shared/{token}/comments", status_code=201)
@costs(Cost.HEAVY)
def add_shared_comment(token: Token, body: CommentIn, context: Context) -> Comment:
    """Comment on a frame, if the link allows comments: at most 10 a minute from all people with links, 500 in all."""
    project, claims = _opened(context, token)
    _check_comments(claims)
    return write_comment(context, project.id, body, by_link=True)


def _check_comments(claims: Claims) -> None:
    if not claims.comments:
        raise Forbidden("This link is to look at the project only.", field="token",
                        remedy="Ask for a link that allows comments.")  # fmt: skip


def _shared(context: ServiceContext, token: str) -> Project:
    """The project of a valid token. Raises Gone, without the reason."""
    return _opened(context, token)[0]


def _opened(context: ServiceContext, token: str) -> tuple[Project, Claims]:
    """The project of a valid token, and what the token allows. Raises Gone, without the reason."""
    claims = verify(token, context.webhook_secrets.master(), time.time())
    if claims is not None and _is_key_valid(context, claims.key):
        try:
            project = context.farm.projects.get(claims.project)
            if project.deleted_at is None and context.farm.projects.share_epoch(project.id) == claims.epoch:
                return project, claims
        except NotFound:
            pass
    raise Gone("This link shows nothing any more.", field="token", remedy="Ask for a new link.")


def _sharing_key(context: ServiceContext, caller: Principal) -> str:
    """What the caller's links end with: a stored key, the present admin key, the user who has signed in (a session is
    shorter than a link), or "" for an open service."""
    if caller.session:
        return f"{_USER}{caller.user}"
    return _admin_key(context) if caller.user == OPERATOR.user else caller.key


def _admin_key(context: ServiceContext) -> str:
    """The admin key's name in a token: a fingerprint, which changes with the key and does not reveal it."""
    key = context.settings.admin_key
    return "" if key is None else f"admin-{fingerprint(key.get_secret_value(), context.webhook_secrets.master())}"


def _is_key_valid(context: ServiceContext, key_id: str) -> bool:
    if not key_id:
        return context.settings.open
    if key_id == _admin_key(context):
        return True
    if key_id.startswith(_USER):
        return context.farm.owners.is_active(key_id.removeprefix(_USER))
    return context.farm.keys.is_valid(key_id)
