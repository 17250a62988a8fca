"""/v1/projects/{project_id}/versions: every version of a document, named and brought back."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import Response

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader, Submitter
from service.projects.lookup import IfMatch, document_quota, etag, expected_version, find_project
from service.projects.schemas import LabelIn, ProjectId, ProjectOut, Version, VersionOut, project_out
from service.routing import Router
from service.schemas import Cursor, Limit, Listing
from workers.contract.project import ProjectVersion

router = Router(prefix="/v1/projects/{project_id}/versions", tags=["projects"])


@router.get("")
def list_versions(
    project_id: ProjectId, context: Context, caller: Reader, cursor: Cursor = None, limit: Limit = 50
) -> Listing[ProjectVersion]:
    """The project's versions, newest first. All versions of the last 7 days, one per hour of earlier ones, and all
    named ones; of more than 500, every second one of the older half is deleted."""
    find_project(context, caller, project_id)
    page = context.farm.projects.versions(project_id, cursor, limit)
    return Listing(page.items, page.cursor)


@router.get("/{version}")
@costs(Cost.HEAVY)
def get_version(project_id: ProjectId, version: Version, context: Context, caller: Reader) -> VersionOut:
    """One version with its document."""
    find_project(context, caller, project_id)
    found, document = context.farm.projects.document(project_id, version)
    return VersionOut(**asdict(found), document=document)


@router.put("/{version}/label")
def label_version(
    project_id: ProjectId, version: Version, body: LabelIn, context: Context, caller: Submitter
) -> ProjectVersion:
    """Name a version, so that it is kept."""
    find_project(context, caller, project_id)
    return context.farm.projects.label(project_id, version, body.label)


@router.post("/{version}/restore")
@costs(Cost.HEAVY)
def restore_version(
    project_id: ProjectId, version: Version, response: Response, context: Context, caller: Submitter,
    if_match: IfMatch = None,
) -> ProjectOut:  # fmt: skip
    """Save the document of an earlier version as a new version."""
    stored = find_project(context, caller, project_id)
    expected, limit = expected_version(if_match, stored), document_quota(context, caller, stored.owner)
    _, document = context.farm.projects.document(project_id, version)
    project = context.farm.projects.save(project_id, expected, document, caller.user, limit)
    response.headers["ETag"] = etag(project.version)
    return project_out(project, document)
