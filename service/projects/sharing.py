"""Shared links: read-only access to one project for anyone who has the link, until it expires."""

from __future__ import annotations

import time
from typing import Annotated

from fastapi import Path, Request, Response

from service.access.admission import Cost, costs
from service.access.keys import OPERATOR, Principal
from service.context.depends import Context, ServiceContext, Sharer, Submitter
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
from service.projects.tokens import Claims, fingerprint, sign, verify
from service.routing import Router
from service.schemas import AssetId, JobId, Listing, binary
from service.serving import serve
from workers.contract.project import Project
from workers.errors import NotFound

router = Router(tags=["projects"])

Token = Annotated[str, Path(max_length=1000, description="As the link has it.")]


@router.post("/v1/projects/{project_id}/share", status_code=201)
def share_project(project_id: ProjectId, body: ShareIn, context: Context, caller: Sharer) -> ShareOut:
    """Make a link that shows the project, its jobs and results to anyone who has it, without a key. It ends with its
    time, with the project, with `DELETE .../share`, and with the key that made it. Needs the scopes submit and read."""
    find_project(context, caller, project_id)
    expires_at = int(time.time() + body.days * 86400)
    claims = Claims(
        project_id, _sharing_key(context, caller), context.farm.projects.share_epoch(project_id), expires_at
    )
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


def _shared(context: ServiceContext, token: str) -> Project:
    """The project of a valid token. Raises Gone, without the reason."""
    claims = verify(token, context.webhook_secrets.master(), time.time())
    if claims is not None and _is_key_valid(context, claims.key):
        try:
            project = context.farm.projects.get(claims.project)
            if project.deleted_at is None and context.farm.projects.share_epoch(project.id) == claims.epoch:
                return project
        except NotFound:
            pass
    raise Gone("This link shows nothing any more.", field="token", remedy="Ask for a new link.")


def _sharing_key(context: ServiceContext, caller: Principal) -> str:
    """The key with which the caller's links end: a stored key, the present admin key, or "" for an open service."""
    return _admin_key(context) if caller == OPERATOR else caller.key


def _admin_key(context: ServiceContext) -> str:
    """The admin key's name in a token: a fingerprint, which changes with the key and does not reveal it."""
    key = context.settings.admin_key
    return "" if key is None else f"admin-{fingerprint(key.get_secret_value(), context.webhook_secrets.master())}"


def _is_key_valid(context: ServiceContext, key_id: str) -> bool:
    if not key_id:
        return context.settings.open
    if key_id == _admin_key(context):
        return True
    try:
        return context.farm.keys.get(key_id).revoked_at is None
    except NotFound:
        return False
