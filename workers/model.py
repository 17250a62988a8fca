"""Data types of a render farm: asset, job, step, task, attempt, event. The store keeps them, the API shows them.

The terms are those of Open Job Description. Times are seconds since the epoch, UTC, as floats. Ids are sortable strings
with a prefix: `ast_`, `job_`, `tsk_`, `att_`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, StrEnum
from typing import Any, Final

from pipeline.methods.base import Resources
from pipeline.video.media import SourceOptions

Json = dict[str, Any]

MAX_SEED = 2**53 - 1
"""The largest integer that every JSON parser represents exactly."""
MAX_LABELS, MAX_LABEL_NAME, MAX_LABEL_VALUE = 32, 80, 200
"""Maximum number of labels of a job; maximum characters of a label's name and value."""
MAX_NAME, MAX_URL = 200, 2000
"""Maximum characters of a job's name and of a webhook's URL."""
MAX_PRIORITY = 100
EXPORT_LABEL = "export"
"""Label of an export (`farm.exports`): the id of the job whose film it converts."""
MAX_QUALITY = 51
"""Largest constant rate factor."""


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
class OutputSpec:
    """The output of a job."""

    format: str = "mp4"
    """Name of an output format: see `pipeline.formats`."""
    quality: int = 20
    """Constant rate factor of the codec, 0 (lossless) to 51."""
    artefacts: tuple[str, ...] = ()
    """Optional artefacts of the method, for example "svg"."""
    report: bool = False
    """Whether the result is measured against the source (`pipeline.quality`)."""


WARN, FAIL = "warn", "fail"
"""Values of `JobRequest.on_damage`."""


@dataclass(frozen=True)
class JobRequest:
    """A submitted job. `inputs` maps input names of the method to asset ids."""

    method: str
    inputs: dict[str, str]
    params: Json = field(default_factory=dict)
    seed: int = 0
    output: OutputSpec = field(default_factory=OutputSpec)
    priority: int = 0
    """-100..100, higher first."""
    name: str = ""
    labels: dict[str, str] = field(default_factory=dict)
    webhook: str = ""
    """URL that receives a message when the job ends, or empty."""
    frames: tuple[int, int] | None = None
    """[first, end) of the video; None: all. The job's inputs number frames as the whole video does."""
    on_damage: str = WARN
    """Behaviour if frames of an input are missing or unreadable: "warn" (use the readable frames, and add a warning to
    the job) or "fail" (the job fails with the code "damaged-media" before it paints them)."""
    source: SourceOptions = field(default_factory=SourceOptions)
    """How the input `video` is read: which of its streams, and its fields."""


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
    """"damaged-input", "planned-again", or the code of a `pipeline.video.media.Note`."""
    message: str
    """One sentence, for example "The source is damaged: frames 22-95 of 96 are missing."."""
    input: str
    """Name of the input; empty: it is about none."""
    damage: Json
    """"frames": number of frames of the undamaged file; "unreadable", "missing": runs [start, stop) of such frames.
    Empty, unless the code is "damaged-input"."""


CPU, PEAK_MEMORY = "cpu", "peak_bytes"
"""Names of an attempt's CPU seconds and peak memory, which are stored beside the seconds of its stages."""


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
class EarlierTask:
    """A finished task of the job on which a job is based, and its recorded reads: see `workers.execution.reuse`."""

    trace: Json
    result: Json
    artefacts: dict[str, str]
    """"step/name" -> blob key."""
    segment: str | None
    """Blob key of its emitted frames."""


@dataclass(frozen=True)
class TaskOrder:
    """Everything that a worker needs to run one attempt. Can be written as JSON."""

    attempt_id: str
    job_id: str
    task_id: str
    step: str
    method: str
    """A method's name; the step "assemble" is the platform's own last step of every job."""
    key: str
    args: Json
    emits: tuple[int, int] | None
    params: Json
    seed: int
    inputs: dict[str, str]
    """Input name -> blob key."""
    input_info: dict[str, Json]
    """Input name -> the asset's info."""
    output: OutputSpec
    results: dict[str, dict[str, Json]]
    """Results of the tasks of finished steps: step -> key -> result."""
    artefacts: dict[str, str]
    """"step/name" -> blob key of every artefact that the task may load: see `pipeline.methods.tasks.Task.after`."""
    after: tuple[str, ...] = ()
    """Tasks on which it depends, in plan order: "key" in this step, "step/key" in an earlier one."""
    segments: tuple[tuple[int, int, str], ...] = ()
    """For "assemble": (start, stop, blob key) of every emitted run, in order."""
    stages: dict[str, dict[str, float]] = field(default_factory=dict)
    """For "assemble": step -> stage -> seconds, summed over the step's tasks."""
    resources: Resources | None = None
    """Resources of a machine; None: the farm's settings for every task."""
    frames: tuple[int, int] | None = None
    """Rendered piece of the video, as in the request. All other frame numbers of the order count from its start."""
    leads: bool = False
    """Whether later tasks of this step depend on it."""
    on_damage: str = WARN
    """Same values as in `JobRequest`."""
    source: SourceOptions = field(default_factory=SourceOptions)
    """As in `JobRequest`."""
    earlier: EarlierTask | None = None
    """The same task of an earlier job, whose result is used if none of its recorded reads has changed."""
    traced: bool = False
    """Whether later jobs may use the result: the task records its reads, and artefacts are named after their values."""
    versions: tuple[tuple[str, int], ...] = ()
    """(Name, version) of the job's steps up to this one: see `workers.jobs.plan_versions`."""


@dataclass(frozen=True)
class TaskOutcome:
    """Result of one attempt. Its blobs are committed; it counts only once the store has accepted it."""

    attempt_id: str
    result: Json
    artefacts: dict[str, str]
    """"step/name" -> blob key."""
    files: dict[str, tuple[str, str]]
    """Downloadable name -> (blob key, media type)."""
    segment: str | None
    """Blob key of the encoded run of frames, if the task emits."""
    stages: dict[str, float]
    """Stage -> wall seconds; "decode", "encode" and "method" (wall of the method itself, overlaps counted once); and
    "cpu" (CPU seconds) and "peak_bytes" (memory) of the attempt."""
    log: str
    fault: Fault | None = None
    cancelled: bool = False
    warnings: tuple[JobWarning, ...] = ()
    trace: Json | None = None
    """Record of what the task has read; None: its result cannot be reused."""
    reused: bool = False
    """Whether the result was taken from an earlier job's task."""


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
    """Owner of everything created with it, who may have several keys. Its id is that of the owner's first key."""
    name: str
    scopes: frozenset[str]
    """Members of SCOPES."""
    quotas: dict[str, int]
    """The owner's quotas: name -> limit, for the service ("active_jobs", "asset_bytes", "requests_per_minute") and the
    dispatcher ("running_tasks")."""
    created_at: float
    revoked_at: float | None = None


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
