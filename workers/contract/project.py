"""Data types of projects: project, version, job of a project. The store keeps them, the API shows them."""

from __future__ import annotations

from dataclasses import dataclass

from workers.errors import Conflict


@dataclass(frozen=True)
class Project:
    """A project without its document. Times are seconds since the epoch, UTC."""

    id: str
    """`prj_...`"""
    owner: str
    name: str
    version: int
    """Number of the newest version, from 1."""
    created_at: float
    updated_at: float
    deleted_at: float | None = None
    """Time of its deletion; it can be restored for `FarmSettings.project_undo_s` after."""


@dataclass(frozen=True)
class ProjectVersion:
    """One version of a project's document."""

    project_id: str
    version: int
    at: float
    author: str
    """Owner of the key that saved it."""
    label: str
    size_bytes: int
    """Size of the document as JSON."""
    jobs: tuple[str, ...] = ()
    """Jobs that were submitted from this version."""


@dataclass(frozen=True)
class ProjectJob:
    """A job that was submitted from a project."""

    job_id: str
    shot: str
    variant: str | None
    version: int
    at: float


@dataclass(frozen=True)
class Comment:
    """A comment on a frame of a project."""

    id: str
    """`cmt_...`"""
    shot: str
    frame: int
    """Of the shot's clip, from 0."""
    author: str
    """Name that its writer has given; empty: none."""
    by_link: bool
    """Whether somebody with a link has written it; else the owner."""
    text: str
    at: float


class VersionMismatch(Conflict):
    """The stored version is not the one that was changed; `stored` is its number."""

    code = "version-mismatch"

    def __init__(self, expected: int, stored: int) -> None:
        super().__init__(
            f"Version {stored} of the project is stored, and the change was made on version {expected}.",
            field="If-Match", value=stored, remedy="Load the project again and make the change on its newest version.",
        )  # fmt: skip
        self.expected, self.stored = expected, stored

    def __reduce__(self) -> tuple[object, ...]:
        return VersionMismatch, (self.expected, self.stored)
