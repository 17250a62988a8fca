"""/v1/projects/{project_id}/comments: comments on frames, by the owner and by people with a link that allows it."""

from __future__ import annotations

from service.access.admission import Cost, costs
from service.context.depends import Context, Reader, ServiceContext, Submitter
from service.projects.lookup import find_project
from service.projects.schemas import CommentId, CommentIn, ProjectId
from service.routing import Router
from service.schemas import Listing
from workers.contract.project import Comment
from workers.errors import NotFound

router = Router(prefix="/v1/projects/{project_id}/comments", tags=["projects"])


@router.get("")
def list_comments(project_id: ProjectId, context: Context, caller: Reader) -> Listing[Comment]:
    """Comments on the project's frames, in the order in which they were written."""
    find_project(context, caller, project_id)
    return Listing(tuple(context.farm.comments.of(project_id)), None)


@router.post("", status_code=201)
@costs(Cost.HEAVY)
def add_comment(project_id: ProjectId, body: CommentIn, context: Context, caller: Submitter) -> Comment:
    """Comment on a frame. A project has at most 500 comments."""
    find_project(context, caller, project_id)
    return write_comment(context, project_id, body, by_link=False)


@router.delete("/{comment_id}", status_code=204)
def delete_comment(project_id: ProjectId, comment_id: CommentId, context: Context, caller: Submitter) -> None:
    """Delete a comment, whoever has written it."""
    find_project(context, caller, project_id)
    context.farm.comments.remove(project_id, comment_id)


def write_comment(context: ServiceContext, project_id: str, body: CommentIn, *, by_link: bool) -> Comment:
    """Keep a comment. Raises NotFound: the project has no such shot; QuotaExceeded."""
    _, document = context.farm.projects.document(project_id)
    if body.shot not in {shot["id"] for shot in document.get("shots", ())}:
        raise NotFound("The project has no shot of this name.", field="shot", value=body.shot,
                       remedy="Name a shot of its document.")  # fmt: skip
    author, text = body.author.strip(), body.text.strip()
    return context.farm.comments.add(project_id, body.shot, body.frame, author, text, by_link)
