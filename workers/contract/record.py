"""Records of the farm: assets, jobs, tasks, events, keys, deliveries.

The terms are those of Open Job Description. Times are seconds since the epoch, UTC, as floats. Ids are sortable strings
with a prefix: `ast_`, `job_`, `tsk_`, `att_`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any, Final

from workers.contract.request import JobRequest, Json


class RunState(StrEnum):
    """State of a job. The states of its tasks are counted separately."""

    QUEUED = "queued"
    RUNNING = "running"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def final(self) -> bool:
        return self in (RunState.SUCCEEDED, RunState.FAILED, RunState.CANCELLED)


class TaskState(StrEnum):
    WAITING = "waiting"
    """A task on which it depends is not done."""
    READY = "ready"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    """The task has used all its attempts."""
    CANCELLED = "cancelled"


@dataclass(frozen=True)
class Asset:
    """An uploaded file. `id` is `ast_` + SHA-256 of the bytes in hex: the same bytes are the same asset."""

    id: str
    sha256: str
    size_bytes: int
    filename: str
    """File name given by the user, for display only; never used as a path."""
    media_type: str
    kind: str
    """"video", "image", "archive" or "json"."""
    info: Json
    """Results of probing: width, height, frames, fps, duration_s, codec, has_audio, rotation_deg, ..."""
    created_at: float
    owner: str = ""


class AnyOwner(Enum):
    """Type of `ANY_OWNER`."""

    ANY_OWNER = "any owner"


ANY_OWNER: Final = AnyOwner.ANY_OWNER
"""In place of an owner: the assets of all owners. Only an operator (scope "admin") may name it; everybody else reaches
an asset through the entry of one owner. `tests/workers/test_asset_owners.py` lists the modules that use it."""


def asset_key(asset_id: str) -> str:
    """Blob key of an asset's bytes."""
    return f"assets/{asset_id.removeprefix('ast_')}"


@dataclass(frozen=True)
class Fault:
    """Why something failed: a stable code, a message, and a remedy."""

    code: str
    message: str
    remedy: str = ""
    field: str = ""
    value: str | None = None


@dataclass(frozen=True)
class JobWarning:
    """A fact that the user of a job should know although the job continues."""

    code: str
    """"damaged-input", "planned-again", "depth", or the code of a `pipeline.video.media.Note`."""
    message: str
    """One sentence, for example "The source is damaged: frames 22-95 of 96 are missing."."""
    input: str
    """Name of the input; empty: it is about none."""
    damage: Json
    """"frames": number of frames of the undamaged file; "unreadable", "missing": runs [start, stop) of such frames.
    Empty, unless the code is "damaged-input"."""


@dataclass(frozen=True)
class StepView:
    """A step of a job: its tasks by state, and wall seconds of its stages (summed over tasks)."""

    name: str
    title: str
    state: str
    """"waiting", "running", "succeeded" or "failed"."""
    counts: dict[str, int]
    progress: float
    """0..1"""
    seconds: float
    """Summed wall seconds of the step's finished attempts, without decoding and encoding."""
    stages: dict[str, float]
    """Stage name -> summed seconds, including "decode" and "encode"."""
    reused: int = 0
    """Number of tasks whose results were reused from an earlier job."""
    cpu_s: float = 0.0
    """Summed CPU seconds of the step's finished attempts."""
    peak_bytes: int = 0
    """Largest memory of an attempt's process, bytes."""


@dataclass(frozen=True)
class Job:
    """A job as its user sees it."""

    id: str
    state: RunState
    request: JobRequest
    owner: str
    created_at: float
    updated_at: float
    started_at: float | None
    finished_at: float | None
    progress: float
    """0..1"""
    eta_s: float | None
    """Seconds left, None while unknown."""
    counts: dict[str, int]
    """Task state -> number of tasks planned so far."""
    steps: tuple[StepView, ...]
    error: Fault | None
    results: tuple[str, ...]
    """Names of available files: "result", "poster", "sheet", "preview", artefact names."""
    warnings: tuple[JobWarning, ...]


@dataclass(frozen=True)
class Submitted(Job):
    """Result of `submit`."""

    new: bool = True
    """Whether this call created the job; False if a job with the same key and request existed."""


@dataclass(frozen=True)
class TaskView:
    id: str
    job_id: str
    step: str
    key: str
    state: TaskState
    progress: float
    attempts: tuple[Json, ...]
    """Per attempt: id, number, worker, started_at, finished_at, outcome, error (Fault as JSON) or None."""
    reused: bool = False
    """Whether its result was taken from an earlier job."""


@dataclass(frozen=True)
class Event:
    """An event of a job. `seq` counts from 1 within a job."""

    seq: int
    job_id: str
    at: float
    type: str
    """"job.state", "job.progress", "job.warning", "job.replanned", "job.waits", "step.planned", "task.state", "log"."""
    data: Json


@dataclass(frozen=True)
class Page:
    """One page of a listing; `cursor` is None on the last."""

    items: tuple[Any, ...]
    cursor: str | None


SCOPES = ("submit", "read", "admin")
"""Permissions of a key; "admin" includes the others."""


@dataclass(frozen=True)
class ApiKey:
    """A key as operators see it. Only a hash of the secret is stored."""

    id: str
    """`key_...`"""
    owner: str
    """The user to whom everything belongs that is created with it, and who may have several keys."""
    name: str
    scopes: frozenset[str]
    """Members of SCOPES."""
    quotas: dict[str, int]
    """The owner's quotas: name -> limit, for the service ("active_jobs", "asset_bytes", "requests_per_minute") and the
    dispatcher ("running_tasks")."""
    created_at: float
    revoked_at: float | None = None
    expires_at: float | None = None
    """When it ends by itself; None: never."""
    used_at: float | None = None
    """About when it was last used, to within an hour; None: never."""
    session: bool = False
    """Whether it is what a browser got when its user signed in."""


@dataclass(frozen=True)
class Delivery:
    """A webhook message in the outbox, written in the transaction that ends the job."""

    id: str
    """`msg_...`: the Standard Webhooks message id, the same in all attempts."""
    job_id: str
    owner: str
    url: str
    body: Json
    """{"type": "job.succeeded" | "job.failed" | "job.cancelled", "timestamp": ISO 8601, "data": {...}}"""
    created_at: float
    tries: int
    """Attempts at delivery so far."""
    state: str = "waiting"
    """"waiting", "delivered" or "dead" (the last try failed)."""
    next_at: float | None = None
    """Time of the next attempt; None once it is delivered or dropped."""
    last_error: str = ""
