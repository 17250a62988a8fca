"""Seats in this process: two threads each. For tests, and for a farm without Ray: a crash takes the service along."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, TypeVar

from workers.live.channel import Halves
from workers.live.model import LiveOrder, Painted, Work
from workers.live.seats import Seat
from workers.model import Json

T = TypeVar("T")


class Painter(Halves, Protocol):
    """As `workers.live.painter.LivePainter`."""

    def warm_up(self) -> None: ...
    def open(self, order: LiveOrder) -> None: ...
    def change(self, params: Mapping[str, Json], inputs: Mapping[str, str]) -> None: ...
    def close(self) -> None: ...


class LocalSeat:
    """A painter and its two threads."""

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._look = ThreadPoolExecutor(1, thread_name_prefix="impasto-live-look")
        self._paint = ThreadPoolExecutor(1, thread_name_prefix="impasto-live-paint")

    def open(self, order: LiveOrder) -> Awaitable[None]:
        self._here(self._look, self._painter.warm_up)  # waits where the pool's practice is not done yet
        return self._here(self._look, self._painter.open, order)

    def look(self, work: Work) -> Awaitable[None]:
        return self._here(self._look, self._painter.look, work)

    def paint(self) -> Awaitable[Painted]:
        return self._here(self._paint, self._painter.paint)

    def change(self, params: Mapping[str, Json], inputs: Mapping[str, str]) -> Awaitable[None]:
        return self._here(self._look, self._painter.change, params, inputs)

    async def leave(self) -> None:
        with contextlib.suppress(RuntimeError):  # the threads are gone already
            await self._here(self._look, self._painter.close)
        self._look.shutdown(wait=False)
        self._paint.shutdown(wait=False)

    @staticmethod
    def _here(pool: ThreadPoolExecutor, work: Callable[..., T], *args: Any) -> Awaitable[T]:
        return asyncio.get_running_loop().run_in_executor(pool, work, *args)


class LocalSeats:
    """As many as are asked for; how many sessions there may be is not decided here."""

    kind = "local"

    def __init__(self, make_painter: Callable[[], Painter]) -> None:
        self._make_painter = make_painter

    def start(self) -> None:
        return

    async def take(self) -> Seat:
        return LocalSeat(self._make_painter())

    def stop(self) -> None:
        return
