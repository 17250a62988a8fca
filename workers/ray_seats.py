"""Seats on a Ray cluster: a dedicated actor a session, so that one session's death or load is no other's.

Actors are kept warm: they have imported everything and let their methods practise before a session takes them. So a
session begins at once, and one whose actor has died goes on within a second. There are always `spares` of them beyond
those in use, made in the background when one is taken; one that a session gives back is used again.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any, TypeVar, cast

import ray
from ray.exceptions import RayActorError, RayError, RayTaskError

from workers.actors import LiveActor
from workers.blobs.base import Blobs
from workers.live.local_seats import Painter
from workers.live.model import LiveOrder, Painted, Work
from workers.live.painter import LivePainter
from workers.live.seats import Seat, SeatLost
from workers.model import Json

log = logging.getLogger(__name__)

T = TypeVar("T")


class RaySeat:
    """A `LivePainter` in an actor."""

    def __init__(self, actor: Any, give_back: Callable[[Any, bool], None]) -> None:
        self._actor, self._give_back = actor, give_back

    def open(self, order: LiveOrder) -> Awaitable[None]:
        return _answer(self._actor.open.remote(order))

    def look(self, work: Work) -> Awaitable[None]:
        return _answer(self._actor.look.remote(work))

    def paint(self) -> Awaitable[Painted]:
        return _answer(self._actor.paint.remote())

    def change(self, params: Mapping[str, Json], inputs: Mapping[str, str]) -> Awaitable[None]:
        return _answer(self._actor.change.remote(dict(params), dict(inputs)))

    async def leave(self) -> None:
        try:
            await asyncio.wait_for(_answer(self._actor.close.remote()), LEAVE_WITHIN_S)
        except Exception:
            self._give_back(self._actor, False)
        else:
            self._give_back(self._actor, True)


OPENCV_THREADS = 2
"""In a live actor, whose process is its own: a frame shall be done soon, where a batch shall cost little."""
LEAVE_WITHIN_S = 5.0
"""An actor that does not let go of its stream in this time is killed."""


async def _answer(ref: Any) -> Any:
    """What an actor's method returns, or what it raised itself; SeatLost if the actor is gone."""
    try:
        return await ref
    except RayTaskError as error:  # the actor lives; our own code has raised
        raise error.cause or error from None
    except RayError as error:
        raise SeatLost("The process that painted has died.", value=type(error).__name__) from None


class RaySeats:
    """
    Args:
        blobs: pickled to the actors as it is; on several machines its folder must be shared by them.
        spares: warm actors beyond those in use.
        make_painter: made once an actor; None: a LivePainter over `blobs`.
    """

    kind = "ray"

    def __init__(self, blobs: Blobs, spares: int, make_painter: Callable[[], Painter] | None = None) -> None:
        self._spares = spares
        self._make_painter: bytes = cast(Any, ray.cloudpickle).dumps(
            make_painter or partial(LivePainter, blobs, threads=OPENCV_THREADS)
        )
        self._lock = threading.Lock()
        self._idle: list[tuple[Any, Any]] = []
        """(actor, reference that is there once it is warm), the warmest first."""
        self._stopped = False

    def start(self) -> None:
        """Ray must be connected: the pool starts first."""
        self._refill()

    async def take(self) -> Seat:
        """The warmest actor there is; waits until it is warm."""
        while True:
            actor, warm = self._pick()
            self._refill()
            try:
                await warm
                return RaySeat(actor, self._given_back)
            except RayActorError:
                log.warning("a live worker died before it was used")
            except BaseException:
                self._given_back(actor, True, warm)
                raise

    def stop(self) -> None:
        with self._lock:
            self._stopped, idle, self._idle = True, self._idle, []
        for actor, _ in idle:
            ray.kill(actor)

    def _pick(self) -> tuple[Any, Any]:
        with self._lock:
            if not self._idle:
                self._idle.append(self._new())
            ready, _ = ray.wait([warm for _, warm in self._idle], num_returns=len(self._idle), timeout=0)
            first = next((i for i, (_, warm) in enumerate(self._idle) if warm in ready), 0)
            return self._idle.pop(first)

    def _refill(self) -> None:
        with self._lock:
            while len(self._idle) < self._spares and not self._stopped:
                self._idle.append(self._new())

    def _new(self) -> tuple[Any, Any]:
        actor = LiveActor.remote(self._make_painter)
        return actor, actor.warm_up.remote()

    def _given_back(self, actor: Any, sound: bool, warm: Any = None) -> None:
        """Keep it for the next session: one more than the spares, so that sessions that come and go start nothing."""
        with self._lock:
            kept = sound and not self._stopped and len(self._idle) <= self._spares
            if kept:
                self._idle.insert(0, (actor, warm or ray.put(None)))
        if not kept:
            ray.kill(actor)
