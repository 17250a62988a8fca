"""Data that operators inspect and control: workers, machines, failures, timelines of attempts, live sessions.

A *worker* is a process that takes tasks (`impasto serve`, `impasto worker`): in the store, a dispatcher. It has
*slots*: each runs one attempt at a time, on some *node*, a machine (in a Ray cluster, one of its nodes). Draining a
worker or a node means that running attempts finish and no new ones start there, so that it can be upgraded without
losing work. Pausing the queue does the same for all workers at once. Both orders are kept in the store, and all workers
follow them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from workers.contract.request import Json


class DrainScope(StrEnum):
    """Kinds of places that can be drained: the whole queue, a worker process, or a node."""

    QUEUE = "queue"
    """The whole queue."""
    WORKER = "worker"
    NODE = "node"


@dataclass(frozen=True)
class Slot:
    """A place of a pool that runs one attempt at a time."""

    name: str
    """Unique in its worker."""
    node: str
    cpus: float = 1.0
    gpus: float = 0.0
    memory_bytes: int = 0
    """Memory reserved for it; 0: none."""


@dataclass(frozen=True)
class WorkerInfo:
    """Identity of a worker process, recorded at its start."""

    host: str
    role: str
    """"serve" (answers requests, too) or "worker"."""
    kind: str
    """Kind of its slots: "local" or "ray"."""
    version: str


@dataclass(frozen=True)
class Drain:
    """An operator's order that a place starts nothing new."""

    place: DrainScope
    name: str
    """Id of the place; empty for the queue."""
    at: float
    by: str
    """Owner of the key that was used; empty without one."""
    reason: str = ""


@dataclass(frozen=True)
class RunningAttempt:
    """The attempt that a slot runs now."""

    attempt_id: str
    task_id: str
    job_id: str
    method: str
    step: str
    key: str
    number: int
    progress: float
    """0..1"""
    started_at: float
    slot: str
    """Node of the slot; empty while the attempt is being sent."""
    node: str


@dataclass(frozen=True)
class WorkerView:
    id: str
    host: str
    role: str
    kind: str
    version: str
    state: str
    """"live", "away" (silent for longer than its lease), "draining" (takes nothing new, still runs something) or
    "drained"."""
    started_at: float
    seen_at: float
    """Time of its last heartbeat."""
    slots: tuple[Slot, ...]
    at_work: tuple[RunningAttempt, ...]
    drain: Drain | None = None


@dataclass(frozen=True)
class NodeView:
    name: str
    state: str
    """"open", "draining" (something still runs there) or "drained"."""
    slots: int
    busy: int
    cpus: float
    gpus: float
    memory_bytes: int
    workers: tuple[str, ...]
    """Ids of the workers with slots there."""
    drain: Drain | None = None


@dataclass(frozen=True)
class Failure:
    """An attempt that did not succeed."""

    attempt_id: str
    task_id: str
    job_id: str
    job_name: str
    job_state: str
    owner: str
    method: str
    step: str
    key: str
    task_state: str
    number: int
    outcome: str
    """"failed" or "interrupted"."""
    worker: str
    slot: str
    started_at: float
    finished_at: float
    error: Json | None


@dataclass(frozen=True)
class Violation:
    """A violated invariant of the database."""

    kind: str
    """Kind of the inconsistency, for example "task-without-attempt"."""
    id: str
    """Id of the affected job, task, attempt, message or worker."""
    message: str
    remedy: str


@dataclass(frozen=True)
class TimelineBar:
    """One attempt on a job's timeline."""

    attempt_id: str
    task_id: str
    step: str
    key: str
    number: int
    worker: str
    slot: str
    outcome: str
    """"running", "succeeded", "failed", "interrupted", "released" or "cancelled"."""
    started_at: float
    finished_at: float | None
    code: str = ""
    """Error code; empty if it has not failed."""


@dataclass(frozen=True)
class AttemptLogView:
    attempt_id: str
    task_id: str
    job_id: str
    number: int
    outcome: str
    worker: str
    slot: str
    error: Json | None
    log: str


@dataclass(frozen=True)
class LiveView:
    """A live session of any process."""

    id: str
    process: str
    owner: str
    method: str
    width: int
    height: int
    opened_at: float
    connected: bool
    """False: it waits for its client to reconnect."""
    figures: Json = field(default_factory=dict)
    """Statistics of the whole session, as in the `stats` message of the live protocol."""
    ending: bool = False
    """An operator has ordered its end."""
