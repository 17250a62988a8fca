"""Request and response bodies of projects."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

from fastapi import Path
from pydantic import BaseModel, ConfigDict, Field

from pipeline.methods.parts import FrameNumber, FrameRange, Id
from service.jobs.schemas import JobOut, job_out
from service.prefix import Address
from workers.contract.project import Project, ProjectJob
from workers.contract.record import Job
from workers.contract.request import Json
from workers.projects.document import Output
from workers.projects.faults import DocumentFault
from workers.projects.joining import Chapter
from workers.projects.submissions import Selection

CommentId = Annotated[str, Path(pattern=r"^cmt_[0-9a-z]{26}$", description="A comment's id (`cmt_...`).")]
ProjectId = Annotated[str, Path(pattern=r"^[A-Za-z0-9_-]{1,100}$", description="A project's id (`prj_...`).")]
Version = Annotated[int, Path(ge=1, le=2**31 - 1, description="Number of a version, from 1.")]


class _In(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ProjectIn(_In):
    name: str = Field(default="Untitled", min_length=1, max_length=200)
    document: Json | None = Field(default=None, description="None: an empty one with this name.")


class LabelIn(_In):
    label: str = Field(max_length=200, description="Empty: take the label away.")


class ShareIn(_In):
    days: float = Field(default=30.0, gt=0, le=3650, description="How long the link lasts.")
    comments: bool = Field(default=False, description="Whether people with the link may comment on frames.")


class CommentIn(_In):
    """A comment on a frame."""

    shot: Id
    frame: FrameNumber = Field(description="Of the shot's clip, from 0.")
    text: str = Field(min_length=1, max_length=1000, pattern=r"\S")
    author: str = Field(default="", max_length=60, description="Name of the writer, as it is to be shown.")


class ProjectJobsIn(_In):
    """The jobs to submit."""

    shots: tuple[Id, ...] | None = Field(default=None, max_length=500, description="None: all.")
    variants: tuple[Id, ...] = Field(default=(), max_length=100, description="Each a job; then shots is not read.")
    range: FrameRange | None = Field(default=None, description="This piece of each shot's video.")
    version: int | None = Field(default=None, ge=1, description="None: the newest.")
    output: Output | None = Field(default=None, description="Instead of the document's.")
    priority: int = Field(default=0, ge=-100, le=100)
    changed: bool = Field(
        default=False, description="Leave out shots with a film, finished or in work, of exactly the same content."
    )

    def selection(self) -> Selection:
        return Selection(self.shots, self.variants, self.range, self.output, self.priority)


@dataclass(frozen=True)
class ProjectLinks:
    self: Address
    versions: Address
    jobs: Address
    export: Address


@dataclass(frozen=True, kw_only=True)
class ProjectOut(Project):
    """A project; only some routes include `document`."""

    links: ProjectLinks
    document: Json | None = None


def project_out(project: Project, document: Json | None = None) -> ProjectOut:
    at = f"/v1/projects/{project.id}"
    own = {field.name: getattr(project, field.name) for field in fields(Project)}
    links = ProjectLinks(at, f"{at}/versions", f"{at}/jobs", f"{at}/export")
    return ProjectOut(**own, links=links, document=document)


@dataclass(frozen=True)
class VersionOut:
    """A version with its document."""

    project_id: str
    version: int
    at: float
    author: str
    label: str
    size_bytes: int
    jobs: tuple[str, ...]
    document: Json


@dataclass(frozen=True)
class ProblemsOut:
    """Problems that keep a version from being rendered."""

    version: int
    errors: tuple[DocumentFault, ...]


@dataclass(frozen=True)
class ProjectJobOut:
    """A job of a project; `job` is null once it was deleted."""

    job: JobOut | None
    shot: str
    variant: str | None
    version: int
    at: float


def project_job_out(noted: ProjectJob, job: Job | None) -> ProjectJobOut:
    return ProjectJobOut(None if job is None else job_out(job), noted.shot, noted.variant, noted.version, noted.at)


@dataclass(frozen=True)
class ShareOut:
    """A link that shows a project to anyone who has it."""

    token: str
    url: str
    expires_at: float


@dataclass(frozen=True)
class SharedFilmOut:
    """The film of a shared project. `version`: null while no film of all shots is finished; `comments`: whether the
    link allows comments."""

    version: int | None
    ready: bool
    joined: float | None
    chapters: tuple[Chapter, ...]
    comments: bool
