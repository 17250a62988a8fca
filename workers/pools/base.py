"""Where attempts run: the muscle. `local_pool` runs them in this process, `ray_pool` on a Ray cluster.

A pool is at-least-once and forgetful: it may lose an attempt (its `Report` then says so) and it keeps nothing over a
restart. What is true is in the store; attempt ids fence late answers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Protocol

from workers.model import TaskOrder, TaskOutcome
from workers.operations import Slot


@dataclass(frozen=True)
class Report:
    """What a pool tells the dispatcher about an attempt."""

    attempt_id: str
    progress: float = 0.0
    outcome: TaskOutcome | None = None
    """Set once, at the end."""
    lost: bool = False
    """The worker died; the attempt will never answer."""
    worker: str = ""
    preview: str = ""
    """Blob key of the newest frame, JPEG; empty: none, or as before."""


class Tell(Protocol):
    """How a runner says how far it is, a few times a second."""

    def __call__(self, done: float, preview: str = "") -> None:
        """
        Args:
            done: 0..1
            preview: blob key of the newest frame, JPEG; empty: as before.
        """
        ...


class Pool(Protocol):
    """Runs task orders on some workers. Calls are quick and thread-safe; `listen` is called from any thread."""

    @property
    def capacity(self) -> int:
        """Attempts that may run at once; may change."""
        ...

    @property
    def free(self) -> int:
        """Attempts that may begin now."""
        ...

    @property
    def shares_memory(self) -> bool:
        """Whether tasks of a step have a quicker way to each other than the blob store: see `shelf`."""
        ...

    def drain(self, nodes: Collection[str]) -> None:
        """Let nothing begin on these nodes until the next call; what runs there goes on."""
        ...

    def slots(self) -> tuple[Slot, ...]:
        """Where attempts run; may change."""
        ...

    def start(self, listen: Callable[[Report], None]) -> None: ...

    def submit(self, order: TaskOrder) -> None: ...

    def cancel(self, attempt_id: str) -> None:
        """Ask a running attempt to stop; it answers with an outcome that is `cancelled` within a second."""
        ...

    def abandon(self, attempt_id: str) -> None:
        """Stop waiting for an attempt that reports nothing any more; its worker is replaced."""
        ...

    def describe(self) -> dict[str, object]:
        """Kind, workers, what each is doing: for the ops page."""
        ...

    def stop(self, grace_s: float = 5.0) -> None: ...
