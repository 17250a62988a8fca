"""The interface of pools, which run attempts: `local_pool` in this process, `ray_pool` on a Ray cluster.

A pool delivers at least once and stores nothing: it may lose an attempt (and reports that), and after a restart it has
none. The database is authoritative; attempt ids reject late answers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Protocol

from workers.contract.order import TaskOrder, TaskOutcome
from workers.operator_views import Slot


@dataclass(frozen=True)
class Report:
    """A pool's message to the dispatcher about an attempt."""

    attempt_id: str
    progress: float = 0.0
    outcome: TaskOutcome | None = None
    """Set in the last report only."""
    lost: bool = False
    """The worker died; the attempt will never answer."""
    worker: str = ""
    preview: str = ""
    """Blob key of the newest frame, JPEG; empty: none, or as before."""


class Pool(Protocol):
    """Runs task orders on some workers. Calls are quick and thread-safe; `listen` is called from any thread."""

    @property
    def capacity(self) -> int:
        """Number of attempts that may run at once; it may change."""
        ...

    @property
    def free(self) -> int:
        """Number of attempts that may begin now."""
        ...

    @property
    def shares_memory(self) -> bool:
        """Whether tasks of a step can share artefacts faster than through the blob store: see `artefact_cache`."""
        ...

    def drain(self, nodes: Collection[str]) -> None:
        """Start nothing on these nodes until the next call; running attempts continue."""
        ...

    def slots(self) -> tuple[Slot, ...]:
        """The present slots of the pool, which may change."""
        ...

    def start(self, listen: Callable[[Report], None]) -> None: ...

    def submit(self, order: TaskOrder) -> None: ...

    def cancel(self, attempt_id: str) -> None:
        """Ask a running attempt to stop; within a second it reports a cancelled outcome."""
        ...

    def abandon(self, attempt_id: str) -> str:
        """End an attempt that hangs, with its process, which is replaced.

        Returns:
            What was seen of it, for the log. Empty: nothing was ended, because the attempt waits for its process to
            start, which has a time limit of its own.
        """
        ...

    def moved_bytes(self, attempt_id: str) -> int:
        """Bytes that the attempt's process has read and written so far; 0 if that is not known. An attempt that moves
        bytes does not hang."""
        ...

    def describe(self) -> dict[str, object]:
        """Kind, workers, and their current attempts, for the operations page."""
        ...

    def stop(self, grace_s: float = 5.0) -> None: ...
