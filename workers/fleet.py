"""What operators see and steer: who works, on which machines, what failed, a job's attempts in time, live sessions.

A *worker* is a process that takes tasks (`impasto serve`, `impasto worker`): in the store, a dispatcher. It has
*slots*: each runs one attempt at a time, on some *node*, a machine (in a Ray cluster, one of its nodes). Draining a
worker or a node means that nothing new starts there while what runs is finished, so that it can be upgraded without
losing work. Pausing the queue is the same for all of them at once. Both are kept in the store, and heeded by all.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from workers.farm import Page
from workers.model import Json


class Place(StrEnum):
    """What can be told to start nothing new."""

    QUEUE = "queue"
    """All of it."""
    WORKER = "worker"
    NODE = "node"


@dataclass(frozen=True)
class Slot:
    """Where one attempt at a time runs, as its pool knows it."""

    name: str
    """Unique in its worker."""
    node: str
    cpus: float = 1.0
    gpus: float = 0.0
    memory_bytes: int = 0
    """What is set aside for it; 0: nothing in particular."""


@dataclass(frozen=True)
class Enrolment:
    """Who a worker is, told once at its start."""

    host: str
    role: str
    """"serve" (it answers requests as well) or "worker"."""
    kind: str
    """Where its slots are: "local" or "ray"."""
    version: str


@dataclass(frozen=True)
class Drain:
    """An operator's wish that a place start nothing new."""

    place: Place
    name: str
    """Of the place; empty for the queue."""
    at: float
    by: str
    """Owner of the key that asked; empty without one."""
    reason: str = ""


@dataclass(frozen=True)
class AtWork:
    """What a slot runs now."""

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
    """Empty: it is on its way to one."""
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
    """Its last sign of life."""
    slots: tuple[Slot, ...]
    at_work: tuple[AtWork, ...]
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
    """Ids of those with slots there."""
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
class Bar:
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
    """Of its fault."""


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
    """A live session, of whichever process."""

    id: str
    process: str
    owner: str
    method: str
    width: int
    height: int
    opened_at: float
    connected: bool
    """False: it waits for a client that was lost."""
    figures: Json = field(default_factory=dict)
    """Of the whole session, as in the `stats` message of the live protocol."""
    ending: bool = False
    """An operator has asked for its end."""


class Fleet(Protocol):
    """Listings are pages, read at one moment; cursors are opaque."""

    def workers(self, cursor: str | None = None, limit: int = 50) -> Page:
        """`WorkerView` items, the longest alive first."""
        ...

    def nodes(self) -> list[NodeView]:
        """Those where a worker that is not away has slots, and those that are drained; by name."""
        ...

    def drains(self) -> list[Drain]:
        """What is drained now, the queue among it."""
        ...

    def drain(self, place: Place, name: str = "", by: str = "", reason: str = "") -> Drain:
        """Start nothing new there. Twice is the same as once. Raises NotFound: there is no such place."""
        ...

    def resume(self, place: Place, name: str = "") -> None:
        """Work may start there again. Twice is the same as once. Raises NotFound: there is no such place."""
        ...

    def failures(self, job_id: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        """`Failure` items, newest first."""
        ...

    def attempt_log(self, attempt_id: str) -> AttemptLogView:
        """Raises NotFound."""
        ...

    def timeline(self, job_id: str, cursor: str | None = None, limit: int = 500) -> Page:
        """`Bar` items, the latest begun first. Raises NotFound."""
        ...

    def now(self) -> float:
        """The clock that all these times are of."""
        ...

    # -- live sessions

    def publish_live(self, process: str, sessions: Sequence[LiveView]) -> Collection[str]:
        """These, and no others, are the live sessions of `process`; the ids of those that are to end."""
        ...

    def live(self, cursor: str | None = None, limit: int = 50) -> Page:
        """`LiveView` items, oldest first; without those of processes that have been silent for long."""
        ...

    def end_live(self, session_id: str) -> None:
        """Let its process end it, within seconds. Raises NotFound."""
        ...
