"""The order of one attempt of a task, and its outcome. Both can be written as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

from pipeline.methods.base import Resources
from pipeline.video.media import SourceOptions
from workers.contract.record import Fault, JobWarning
from workers.contract.request import WARN, Json, OutputSpec

CPU, PEAK_MEMORY = "cpu", "peak_bytes"
"""Names of an attempt's CPU seconds and peak memory, which are stored beside the seconds of its stages."""


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
    """Piece of the video that is the result, as in the request."""
    has_dependents: bool = False
    """Whether later tasks of this step depend on it."""
    on_damage: str = WARN
    """Same values as in `JobRequest`."""
    source: SourceOptions = field(default_factory=SourceOptions)
    """As in `JobRequest`."""
    earlier: EarlierTask | None = None
    """The same task of an earlier job, whose result is used if none of its recorded reads has changed."""
    records_reads: bool = False
    """Whether later jobs may use the result: the task records its reads, and artefacts are named after their values."""
    versions: tuple[tuple[str, int], ...] = ()
    """(Name, version) of the job's steps up to this one: see `workers.jobs.plan_versions`."""

    @property
    def reading(self) -> SourceOptions:
        """How the video is read: as its colours alone, if the film gets its opacity."""
        return replace(self.source, opacity="straight") if self.output.reads_colours else self.source


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


class ProgressReport(Protocol):
    """Reports progress, a few times a second."""

    def __call__(self, done: float, preview: str = "") -> None:
        """
        Args:
            done: 0..1
            preview: blob key of the newest frame, JPEG; empty: as before.
        """
        ...
