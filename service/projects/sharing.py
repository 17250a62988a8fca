"""Shared links: read-only access to one project for anyone who has the link, until it expires."""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import Path, Request, Response

from service.access.depends import Context, ServiceContext, Submitter
from service.access.keys import EVERYONE, OPERATOR
from service.errors import Gone
from service.projects.lookup import find_project
from service.projects.schemas import (
    ProjectId,
    ProjectJobOut,
    ProjectOut,
    ShareIn,
    ShareOut,
    project_job_out,
    project_out,
)
from service.projects.tokens import Claims, sign, verify
from service.routing import Router
from service.schemas import AssetId, JobId, Listing, binary
from service.serving import serve
from workers.errors import NotFound
from workers.projects.model import Project

router = Router(tags=["projects"])

Token = Annotated[str, Path(max_length=1000, description="As the link has it.")]


@router.post("/v1/projects/{project_id}/share", status_code=201)
def share_project(project_id: ProjectId, body: ShareIn, context: Context, caller: Submitter) -> ShareOut:
    """Make a link that shows the project, its jobs and results to anyone who has it, without a key."""
    find_project(context, caller, project_id)
    expires_at = int(time.time() + body.days * 86400)
    claims = Claims(project_id, caller.owner, context.farm.projects.share_epoch(project_id), expires_at)
    token = sign(claims, context.webhook_secrets.master())
    return ShareOut(token, f"/shared/{token}", float(expires_at))


@router.delete("/v1/projects/{project_id}/share", status_code=204)
def end_shares(project_id: ProjectId, context: Context, caller: Submitter) -> None:
    """End every link of the project."""
    find_project(context, caller, project_id)
    context.farm.projects.end_shares(project_id)


@router.get("/v1/shared/{token}")
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
        raise NotFound("The project has no such asset.", field="asset_id", value=asset_id)
    return serve(context, context.farm.assets.file(asset_id), request)


@router.head("/v1/shared/{token}/jobs/{job_id}/result", include_in_schema=False)
@router.get(
    "/v1/shared/{token}/jobs/{job_id}/result", response_class=Response, responses=binary("video/mp4", "The film")
)
def get_shared_result(token: Token, job_id: JobId, request: Request, context: Context) -> Response:
    """The result of one of the shared project's jobs, whole or a range."""
    project = _shared(context, token)
    if job_id not in {noted.job_id for noted, _ in context.farm.projects.jobs(project.id)}:
        raise NotFound("The project has no such job.", field="job_id", value=job_id)
    return serve(context, context.farm.files.get(job_id, "result"), request)


def _shared(context: ServiceContext, token: str) -> Project:
    """The project of a valid token. Raises Gone, without the reason."""
    claims = verify(token, context.webhook_secrets.master(), time.time())
    if claims is not None and _key_lives(context, claims.key):
        try:
            project = context.farm.projects.get(claims.project)
            if project.deleted_at is None and context.farm.projects.share_epoch(project.id) == claims.epoch:
                return project
        except NotFound:
            pass
    raise Gone("This link shows nothing any more.", field="token", remedy="Ask for a new link.")


def _key_lives(context: ServiceContext, key_id: str) -> bool:
    if key_id in (EVERYONE.owner, OPERATOR.owner):
        return True
    return any(key.id == key_id and key.revoked_at is None for key in context.farm.keys.list())
