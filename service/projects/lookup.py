"""Projects as their owner may see them, and the version that a change was made on."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import Header

from service.access.keys import Principal
from service.context.depends import ServiceContext
from service.errors import BadRequest, Gone, PreconditionRequired
from workers.contract.project import Project
from workers.errors import NotFound

IfMatch = Annotated[
    str | None,
    Header(max_length=100, description='The `ETag` of the version that the change was made on, as "7".'),
]
_TAG = re.compile(r'"(\d{1,9})"')


def find_project(context: ServiceContext, caller: Principal, project_id: str, deleted: bool = False) -> Project:
    """The project.

    Args:
        deleted: whether to return a deleted project, too.

    Raises:
        NotFound: it does not exist, or belongs to another owner; the error does not tell which.
        Gone: it was deleted, and can be restored.
    """
    try:
        project = context.farm.projects.get(project_id)
    except NotFound:
        project = None
    if project is None or not caller.sees(project.owner):
        raise NotFound(
            "Project not found.", field="project_id", value=project_id, remedy="See GET /v1/projects for yours."
        )
    if project.deleted_at is not None and not deleted:
        raise Gone(
            "The project was deleted.", field="project_id", value=project_id,
            remedy=f"POST /v1/projects/{project_id}/restore brings it back.",
        )  # fmt: skip
    return project


def document_quota(context: ServiceContext, caller: Principal, owner: str) -> int | None:
    """Bytes that the versions of all projects of `owner` may take when `caller` saves one; None: any number, because
    the caller is an operator, whose own quotas do not apply."""
    limit = caller.quotas.get("document_bytes", context.settings.quota_document_bytes)
    return limit if caller.owner == owner else None


def etag(version: int) -> str:
    return f'"{version}"'


def expected_version(if_match: str | None, project: Project) -> int:
    """The version that the caller has changed.

    Raises:
        PreconditionRequired: the request has no If-Match.
        BadRequest: If-Match is not an entity tag of this service.
    """
    if if_match is None:
        raise PreconditionRequired(
            "A change needs the version that it was made on.", field="If-Match",
            remedy=f"Send the header If-Match with the ETag that you loaded; stored is {etag(project.version)}.",
        )  # fmt: skip
    if if_match.strip() == "*":
        return project.version
    found = _TAG.fullmatch(if_match.strip())
    if found is None:
        raise BadRequest(
            "This is no version of a project.", field="If-Match", value=if_match, remedy='Send one ETag, as "7".'
        )
    return int(found[1])
