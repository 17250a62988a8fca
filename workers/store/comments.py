"""Comments on frames of projects in the database. They are deleted with their project."""

from __future__ import annotations

from dataclasses import asdict

from sqlalchemy import Connection, delete, func, insert, select

from workers.contract.project import Comment
from workers.errors import NotFound, QuotaExceeded
from workers.ids import new_id
from workers.store import schema
from workers.store.base import StorePart

MOST_COMMENTS = 500
"""Comments that a project keeps."""
MOST_A_MINUTE = 10
"""Comments on a project that people with its links may write in a minute, together."""
_MINUTE_S = 60.0


class Comments(StorePart):
    """Comments by project."""

    def of(self, project_id: str) -> list[Comment]:
        """All comments on a project, in the order in which they were written."""
        table = schema.project_comments
        query = select(table).where(table.c.project_id == project_id).order_by(table.c.id)
        with self._db.read() as connection:
            rows = connection.execute(query).mappings()
            return [Comment(**{name: row[name] for name in Comment.__dataclass_fields__}) for row in rows]

    def add(self, project_id: str, shot: str, frame: int, author: str, text: str, by_link: bool) -> Comment:
        """Keep a comment on a frame of a shot's clip.

        Args:
            by_link: whether it was written by somebody with a link, so that the limit per minute applies.

        Raises:
            QuotaExceeded: the project has too many comments, or too many were written in the last minute.
        """
        now = self._now()
        comment = Comment(new_id("cmt_"), shot, frame, author, by_link, text, now)
        with self._db.write() as connection:
            _check_limits(connection, project_id, now - _MINUTE_S if by_link else None)
            row = {"project_id": project_id, **asdict(comment)}
            connection.execute(insert(schema.project_comments).values(row))
        return comment

    def remove(self, project_id: str, comment_id: str) -> None:
        """Delete a comment. Raises NotFound."""
        table = schema.project_comments
        where = (table.c.project_id == project_id, table.c.id == comment_id)
        with self._db.write() as connection:
            if connection.execute(delete(table).where(*where)).rowcount == 0:
                raise NotFound("Comment not found.", field="comment_id", value=comment_id,
                               remedy="See GET /v1/projects/{id}/comments.")  # fmt: skip


def _check_limits(connection: Connection, project_id: str, since: float | None) -> None:
    """Raise QuotaExceeded if one more comment is too many; `since`: seconds, where the limit per minute applies."""
    table = schema.project_comments
    of_project = select(func.count()).select_from(table).where(table.c.project_id == project_id)
    if connection.execute(of_project).scalar_one() >= MOST_COMMENTS:
        raise QuotaExceeded(
            f"A project has at most {MOST_COMMENTS} comments.", field="text",
            remedy="Delete comments that are done with.",
        )  # fmt: skip
    if since is None:
        return
    recent = of_project.where(table.c.at > since, table.c.by_link.is_(True))
    if connection.execute(recent).scalar_one() >= MOST_A_MINUTE:
        raise QuotaExceeded(
            f"At most {MOST_A_MINUTE} comments a minute are taken from people with a link.", field="text",
            remedy="Wait a minute.",
        )  # fmt: skip
