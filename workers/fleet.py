"""What operators see and steer: machines and workers, what failed, a job's attempts in time, live sessions.

A *node* is a machine (in a Ray cluster, one of its nodes); a *worker* runs one attempt at a time on it. Draining either
means that nothing new starts there while what runs is finished: so a machine can be upgraded without losing work. A
drain is kept in the store, and heeded by every dispatcher within about a second.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from workers.farm import Page
from workers.model import Json


class Place(StrEnum):
    """What can be drained."""

    NODE = "node"
    WORKER = "worker"


@dataclass(frozen=True)
class PoolWorker:
    """A worker as its pool knows it."""

    name: str
    """Unique among all that are alive: host, process, and thread if need be."""
    node: str
    kind: str
    """"local" or "ray"."""
    cpus: float = 1.0
    gpus: float = 0.0
    memory_bytes: int = 0
    """What is set aside for it; 0: nothing in particular."""


@dataclass(frozen=True)
class Drains:
    """Where nothing new may start."""

    nodes: frozenset[str] = frozenset()
    workers: frozenset[str] = frozenset()

    def hold(self, worker: PoolWorker) -> bool:
        """Whether this worker may start nothing."""
        return worker.node in self.nodes or worker.name in self.workers


@dataclass(frozen=True)
class Drain:
    """An operator's wish that a place be empty."""

    place: Place
    name: str
    at: float
    by: str
    """Owner of the key that asked; empty without one."""
    reason: str = ""


@dataclass(frozen=True)
class AtWork:
    """What a worker runs now."""

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


@dataclass(frozen=True)
class WorkerView:
    name: str
    node: str
    kind: str
    dispatcher: str
    """Who gives it work."""
    cpus: float
    gpus: float
    memory_bytes: int
    state: str
    """"idle", "busy", "draining" (busy, and takes nothing new) or "drained"."""
    drained_by: Place | None
    joined_at: float
    at_work: tuple[AtWork, ...] = ()


@dataclass(frozen=True)
class NodeView:
    name: str
    state: str
    """"open", "draining" (some of its workers still run something) or "drained"."""
    workers: int
    busy: int
    cpus: float
    gpus: float
    memory_bytes: int
    kinds: tuple[str, ...]
    dispatchers: tuple[str, ...]
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
    dispatcher: str
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
    dispatcher: str
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
    error: Json | None
    log: str


@dataclass(frozen=True)
class Pace:
    """Work that ended within one stretch of time."""

    at: float
    """Its beginning."""
    succeeded: int
    failed: int
    """Attempts that failed or were interrupted."""
    frames: int


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
    """Received, painted, dropped, fps, latency_ms {p50, p95, p99}, of the whole session."""
    ending: bool = False
    """An operator has asked for its end."""


class Fleet(Protocol):
    """Listings are pages, read at one moment; cursors are opaque."""

    def nodes(self, cursor: str | None = None, limit: int = 50) -> Page: ...

    def workers(self, node: str | None = None, cursor: str | None = None, limit: int = 50) -> Page: ...

    def drain(self, place: Place, name: str, by: str = "", reason: str = "") -> None:
        """Start nothing new there. Twice is the same as once. Raises NotFound: there is no such place."""
        ...

    def undrain(self, place: Place, name: str) -> None:
        """Work may start there again. Raises NotFound: it is neither there nor drained."""
        ...

    def failures(self, job_id: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        """`Failure` items, newest first."""
        ...

    def attempt_log(self, attempt_id: str) -> AttemptLogView:
        """Raises NotFound."""
        ...

    def timeline(self, job_id: str, cursor: str | None = None, limit: int = 500) -> Page:
        """`Bar` items of `limit` tasks, in plan order. Raises NotFound."""
        ...

    def pace(self, window_s: float, stretch_s: float) -> list[Pace]:
        """The last `window_s`, in stretches, oldest first."""
        ...

    def now(self) -> float:
        """The clock that all these times are of."""
        ...

    # -- live sessions

    def publish_live(self, process: str, sessions: Sequence[LiveView]) -> Collection[str]:
        """These, and no others, are the live sessions of `process`; the ids of those that are to end."""
        ...

    def live(self, cursor: str | None = None, limit: int = 50) -> Page:
        """`LiveView` items, oldest first."""
        ...

    def end_live(self, session_id: str) -> None:
        """Let its process end it, within seconds. Raises NotFound."""
        ...
