"""Workers on a Ray cluster: one dedicated actor per session, so that a crash or load of one session affects no other.

Actors are kept warm: before a session takes one, it has imported everything and run its methods once. Therefore a
session starts at once, and a session whose actor has died continues within a second. `spares` actors are started in
advance, and another one when the last is taken, but no more: a start takes a second of processor time from the running
sessions. Returned actors are reused.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import ray
from ray.exceptions import RayActorError, RayError, RayTaskError

from workers.blobs.base import Blobs
from workers.live.channel import SECRET_BYTES, LiveWorkerClient
from workers.live.local_workers import SessionRenderer
from workers.live.model import FrameRequest, LiveOrder, RenderedFrame
from workers.live.ray_actor import LiveActor
from workers.live.renderer import LiveRenderer
from workers.live.worker import LiveWorker, LiveWorkerLost
from workers.pools.ray_types import RAY, Actor, ObjectRef

log = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class _Warm:
    """An actor, and a reference to the address of its frame server, available once it is warm."""

    actor: Actor
    address: ObjectRef


class RayLiveWorker:
    """A `LiveRenderer` in an actor."""

    def __init__(self, actor: Actor, channel: LiveWorkerClient, give_back: Callable[[bool], None]) -> None:
        self._actor, self._channel, self._give_back = actor, channel, give_back

    def open(self, order: LiveOrder) -> Awaitable[None]:
        return _answer(self._actor.open.remote(order))

    def analyze(self, work: FrameRequest) -> Awaitable[None]:
        return self._channel.analyze(work)

    def paint(self) -> Awaitable[RenderedFrame]:
        return self._channel.paint()

    def change(self, order: LiveOrder) -> Awaitable[None]:
        return _answer(self._actor.change.remote(order))

    async def leave(self) -> None:
        self._channel.close()
        try:
            await asyncio.wait_for(_answer(self._actor.close.remote()), LEAVE_WITHIN_S)
        except Exception:
            self._give_back(False)
        else:
            self._give_back(True)


OPENCV_THREADS = 2
"""Settings of a live actor, which has a process of its own: low latency matters more than low cost."""
LEAVE_WITHIN_S = 5.0
"""An actor that does not close its stream within this time is killed."""


async def _answer(ref: ObjectRef) -> Any:
    """The return value of an actor's method, or the error that it raised; LiveWorkerLost if the actor has died."""
    try:
        return await ref
    except RayTaskError as error:  # the actor is alive; our own code has raised the error
        raise error.cause or error from None
    except RayError as error:
        raise LiveWorkerLost("The process that painted has died.", value=type(error).__name__) from None


class RayLiveWorkers:
    """
    Args:
        blobs: pickled to the actors; several machines must share its folder.
        spares: number of warm actors that are started in advance.
        make_painter: makes the renderer of an actor; None: a LiveRenderer over `blobs`.
    """

    kind = "ray"

    def __init__(self, blobs: Blobs, spares: int, make_painter: Callable[[], SessionRenderer] | None = None) -> None:
        self._spares = spares
        self._make_painter: bytes = RAY.cloudpickle.dumps(
            make_painter or partial(LiveRenderer, blobs, threads=OPENCV_THREADS)
        )
        self._secret = secrets.token_bytes(SECRET_BYTES)
        self._lock = threading.Lock()
        self._idle: list[_Warm] = []
        """Idle actors, those that are warm first."""
        self._stopped = False

    def start(self) -> None:
        """Ray must be connected, so start the pool first."""
        self._refill(self._spares)

    async def take(self) -> LiveWorker:
        """A warm actor, or the one that will be warm first; waits until it is."""
        while True:
            warm = self._pick()
            self._refill(min(1, self._spares))
            try:
                channel = await LiveWorkerClient.connect(await warm.address, self._secret)
                return RayLiveWorker(warm.actor, channel, partial(self._given_back, warm))
            except (RayActorError, OSError) as error:
                log.warning("a live worker died before it was used: %s", error)
                ray.kill(warm.actor)
            except BaseException:
                self._given_back(warm, True)
                raise

    def stop(self) -> None:
        with self._lock:
            self._stopped, idle, self._idle = True, self._idle, []
        for warm in idle:
            ray.kill(warm.actor)

    def _pick(self) -> _Warm:
        with self._lock:
            if not self._idle:
                self._idle.append(self._new())
            ready, _ = ray.wait([warm.address for warm in self._idle], num_returns=len(self._idle), timeout=0)
            first = next((i for i, warm in enumerate(self._idle) if warm.address in ready), 0)
            return self._idle.pop(first)

    def _refill(self, count: int) -> None:
        with self._lock:
            while len(self._idle) < count and not self._stopped:
                self._idle.append(self._new())

    def _new(self) -> _Warm:
        actor = LiveActor.remote(self._make_painter, self._secret)
        return _Warm(actor, actor.warm_up.remote())

    def _given_back(self, warm: _Warm, sound: bool) -> None:
        """Keep the actor for the next session. One more than `spares` are kept, so that short sessions start no
        actor."""
        with self._lock:
            kept = sound and not self._stopped and len(self._idle) <= self._spares
            if kept:
                self._idle.insert(0, warm)
        if not kept:
            ray.kill(warm.actor)
