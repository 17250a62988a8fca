"""The interface of live workers, one per session: threads of this process (`local_workers`) or Ray actors
(`ray_workers`)."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Protocol

from pipeline.errors import ImpastoError
from workers.live.model import FrameRequest, LiveOrder, RenderedFrame


class LiveWorkerLost(ImpastoError):
    """The worker's process died. Its frames are lost; the session may take another worker."""

    code = "worker-lost"


class NoLiveWorker(ImpastoError):
    """Every live worker is taken."""

    code = "busy"

    def __init__(self, message: str, *, retry_after_s: float = 5.0, **parts: object) -> None:
        super().__init__(message, **parts)  # type: ignore[arg-type]
        self.retry_after_s = retry_after_s


class LiveWorker(Protocol):
    """A `LiveRenderer` in this or another process. For one event loop only.

    Calls start at once and run in order. They raise the renderer's errors, or `LiveWorkerLost`. `analyze` and
    `paint` of a frame are called together; `paint` waits for `analyze` in the worker.
    """

    def open(self, order: LiveOrder) -> Awaitable[None]: ...
    def analyze(self, work: FrameRequest) -> Awaitable[None]: ...
    def paint(self) -> Awaitable[RenderedFrame]: ...
    def change(self, order: LiveOrder) -> Awaitable[None]: ...
    async def leave(self) -> None:
        """Return the worker. Never raises; waits only for running calls."""
        ...


class LiveWorkers(Protocol):
    kind: str
    """"local" or "ray"."""

    def start(self) -> None:
        """Start. Call on the main thread."""
        ...

    async def take(self) -> LiveWorker:
        """A worker, a warm one if there is any. Raises NoLiveWorker if none is ready in time."""
        ...

    def stop(self) -> None: ...
