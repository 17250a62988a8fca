"""/v1/projects: documents, saved as versions; a version that the caller has not seen is never overwritten."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import Body, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader, Submitter
from service.errors import UnsupportedMediaType
from service.projects.lookup import IfMatch, document_quota, etag, expected_version, find_project
from service.projects.schemas import ProblemsOut, ProjectId, ProjectIn, ProjectOut, project_out
from service.routing import Router
from service.schemas import Cursor, Limit, Listing, Responses
from service.serving import not_modified
from workers.contract.project import Project, VersionMismatch
from workers.contract.request import Json
from workers.projects.document import empty, json_schema
from workers.projects.parsing import parse_document
from workers.projects.patching import merged, patched
from workers.strict_json import BadJson

router = Router(prefix="/v1/projects", tags=["projects"])

JSON_PATCH, MERGE_PATCH = "application/json-patch+json", "application/merge-patch+json"
_PATCHES = {
    "requestBody": {
        "required": True,
        "content": {
            JSON_PATCH: {"schema": {"type": "array", "items": {"type": "object"}}},
            MERGE_PATCH: {"schema": {"type": "object"}},
        },
    }
}
_UNCHANGED: Responses = {304: {"description": "The client has it already"}}


@router.get("")
def list_projects(
    context: Context,
    caller: Reader,
    deleted: Annotated[bool, Query(description="Those that were deleted and can be restored.")] = False,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> Listing[ProjectOut]:
    """Your projects without their documents, the most recently changed first."""
    page = context.farm.projects.page(caller.only_owner, deleted, cursor, limit)
    return Listing(tuple(project_out(project) for project in page.items), page.cursor)


@router.post("", status_code=201)
@costs(Cost.HEAVY)
def create_project(body: ProjectIn, response: Response, context: Context, caller: Submitter) -> ProjectOut:
    """Begin a project."""
    document = empty(body.name) if body.document is None else body.document
    project = context.farm.projects.create(
        document, caller.owner, caller.user, max_bytes=document_quota(context, caller, caller.owner)
    )
    response.headers["Location"] = f"/v1/projects/{project.id}"
    response.headers["ETag"] = etag(project.version)
    return project_out(project, document)


@router.get("/schema")
def get_schema(_caller: Reader) -> Json:
    """JSON Schema of the document."""
    return json_schema()


@router.get("/{project_id}", response_model=ProjectOut, responses=_UNCHANGED)
@costs(Cost.HEAVY)
def get_project(project_id: ProjectId, request: Request, context: Context, caller: Reader) -> Any:
    """A project with its document. 304 if If-None-Match names its version; 410 if it was deleted."""
    project = find_project(context, caller, project_id)
    if not_modified(request.headers, etag(project.version)):
        return Response(status_code=304, headers={"ETag": etag(project.version)})
    version, document = context.farm.projects.document(project_id)
    headers = {"ETag": etag(version.version), "Cache-Control": "private, no-cache"}
    content = json.dumps({**asdict(project_out(project)), "document": document}, ensure_ascii=False)
    return Response(content, headers=headers, media_type="application/json")  # made here, in a thread, not on the loop


@router.put("/{project_id}")
@costs(Cost.HEAVY)
def put_project(
    project_id: ProjectId,
    document: Annotated[Json, Body(description="The whole document.")],
    response: Response,
    context: Context,
    caller: Submitter,
    if_match: IfMatch = None,
) -> ProjectOut:
    """Save a document. 428 without If-Match, 412 if another version is stored."""
    stored = find_project(context, caller, project_id)
    expected, limit = expected_version(if_match, stored), document_quota(context, caller, stored.owner)
    project = context.farm.projects.save(project_id, expected, document, caller.user, limit)
    response.headers["ETag"] = etag(project.version)
    return project_out(project)


@router.patch("/{project_id}", openapi_extra=_PATCHES)
@costs(Cost.HEAVY)
async def patch_project(
    project_id: ProjectId,
    request: Request,
    response: Response,
    context: Context,
    caller: Submitter,
    if_match: IfMatch = None,
) -> ProjectOut:
    """Save a change to the document: a JSON Patch (RFC 6902) or a JSON Merge Patch (RFC 7396). Otherwise as PUT."""
    if not await request.body():
        raise BadJson("The body is empty.", field="body", remedy="Send a JSON Patch or a JSON Merge Patch.")
    change, kind = await request.json(), request.headers.get("content-type", "").partition(";")[0].strip().lower()

    def save() -> Project:
        stored = find_project(context, caller, project_id)
        expected, limit = expected_version(if_match, stored), document_quota(context, caller, stored.owner)
        if expected != stored.version:
            raise VersionMismatch(expected, stored.version)
        _, before = context.farm.projects.document(project_id, expected)
        return context.farm.projects.save(project_id, expected, _changed(before, change, kind), caller.user, limit)

    project = await run_in_threadpool(save)
    response.headers["ETag"] = etag(project.version)
    return project_out(project)


@router.delete("/{project_id}", status_code=204)
def delete_project(
    project_id: ProjectId,
    context: Context,
    caller: Submitter,
    for_good: Annotated[bool, Query(description="It cannot be restored, and its space is free at once.")] = False,
) -> None:
    """Delete a project. It can be restored for some time (`IMPASTO_PROJECT_UNDO_S`, 30 days by default)."""
    find_project(context, caller, project_id, deleted=True)
    context.farm.projects.delete(project_id)
    if for_good:
        context.farm.projects.remove(project_id)


@router.post("/{project_id}/restore")
def restore_project(project_id: ProjectId, response: Response, context: Context, caller: Submitter) -> ProjectOut:
    """Bring a deleted project back."""
    find_project(context, caller, project_id, deleted=True)
    project = context.farm.projects.restore(project_id)
    response.headers["ETag"] = etag(project.version)
    return project_out(project)


@router.get("/{project_id}/check")
@costs(Cost.HEAVY)
def check_project(project_id: ProjectId, context: Context, caller: Reader) -> ProblemsOut:
    """Problems that keep the project from being rendered, with their places in the document."""
    project = find_project(context, caller, project_id)
    version, value = context.farm.projects.document(project_id)
    found = context.farm.projects.problems(parse_document(value), project.owner)
    return ProblemsOut(version.version, tuple(found))


def _changed(document: Json, change: Any, kind: str) -> Any:
    if kind == JSON_PATCH:
        return patched(document, change)
    if kind == MERGE_PATCH:
        return merged(document, change)
    raise UnsupportedMediaType(
        "This is no patch.", field="Content-Type", value=kind, remedy=f"Send {JSON_PATCH} or {MERGE_PATCH}."
    )
