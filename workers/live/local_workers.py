"""Live workers in this process, two threads each. For tests, and for a farm without Ray: a crash also ends the
service."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol, TypeVar

from workers.live.channel import FrameStages
from workers.live.model import FrameRequest, LiveOrder, RenderedFrame
from workers.live.worker import LiveWorker

T = TypeVar("T")


class SessionRenderer(FrameStages, Protocol):
    """Interface of `workers.live.renderer.LiveRenderer`."""

    def warm_up(self) -> None: ...
    def open(self, order: LiveOrder) -> None: ...
    def change(self, order: LiveOrder) -> None: ...
    def close(self) -> None: ...


class LocalLiveWorker:
    """A painter and its two threads."""

    def __init__(self, painter: SessionRenderer) -> None:
        self._painter = painter
        self._analyze = ThreadPoolExecutor(1, thread_name_prefix="impasto-live-analyze")
        self._paint = ThreadPoolExecutor(1, thread_name_prefix="impasto-live-paint")

    def open(self, order: LiveOrder) -> Awaitable[None]:
        self._here(self._analyze, self._painter.warm_up)  # waits if the warm-up of the pool is still running
        return self._here(self._analyze, self._painter.open, order)

    def analyze(self, work: FrameRequest) -> Awaitable[None]:
        return self._here(self._analyze, self._painter.analyze, work)

    def paint(self) -> Awaitable[RenderedFrame]:
        return self._here(self._paint, self._painter.paint)

    def change(self, order: LiveOrder) -> Awaitable[None]:
        return self._here(self._analyze, self._painter.change, order)

    async def leave(self) -> None:
        with contextlib.suppress(RuntimeError):  # the threads have already ended
            await self._here(self._analyze, self._painter.close)
        self._analyze.shutdown(wait=False)
        self._paint.shutdown(wait=False)

    @staticmethod
    def _here(pool: ThreadPoolExecutor, work: Callable[..., T], *args: object) -> Awaitable[T]:
        return asyncio.get_running_loop().run_in_executor(pool, work, *args)


class LocalLiveWorkers:
    """Makes any number of workers; the number of sessions is limited elsewhere."""

    kind = "local"

    def __init__(self, make_painter: Callable[[], SessionRenderer]) -> None:
        self._make_painter = make_painter

    def start(self) -> None:
        return

    async def take(self) -> LiveWorker:
        return LocalLiveWorker(self._make_painter())

    def stop(self) -> None:
        return
