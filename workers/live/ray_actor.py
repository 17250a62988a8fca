"""The Ray actor of one live session: a thin wrapper around plain classes."""

from __future__ import annotations

import gc
import threading
from typing import cast

import ray

from workers.live.channel import Address, LiveWorkerServer
from workers.live.local_workers import SessionRenderer
from workers.live.model import LiveOrder
from workers.pools.ray_types import RAY, Actor
from workers.process.free_memory import limit_free_memory
from workers.process.starting import WARM_UP_THREAD, lower_priority


class _LiveActor:
    """An actor with a `LiveRenderer`. Frames use its `LiveWorkerServer` and its threads; everything else uses actor
    calls.

    Args:
        make_painter: pickled, so that its imports happen in `warm_up`.
        secret: bytes that a connection must send first.
    """

    def __init__(self, make_painter: bytes, secret: bytes) -> None:
        self._make_painter, self._secret = make_painter, secret
        self._painter: SessionRenderer | None = None
        self._server: LiveWorkerServer | None = None
        limit_free_memory()

    def warm_up(self) -> Address:
        """Import and compile everything; then return the address of the frame server.

        Kernels are loaded at a low priority, because loading takes seconds and would delay the frames of running
        sessions. Imports have the normal priority: at a low one, on a busy machine, they take more than a minute, and a
        session may be waiting for this actor.
        """
        thread = threading.Thread(target=self._get_ready, name=WARM_UP_THREAD)
        thread.start()
        thread.join()
        self._server = LiveWorkerServer(self._here, RAY.util.get_node_ip_address(), self._secret)
        return self._server.address

    def _get_ready(self) -> None:
        painter = cast(SessionRenderer, ray.cloudpickle.loads(self._make_painter)())
        lower_priority()
        painter.warm_up()
        gc.collect()
        gc.freeze()  # imported objects never become garbage; scanning them takes a tenth of a second
        self._painter = painter

    @property
    def _here(self) -> SessionRenderer:
        assert self._painter is not None, "warmed up first"
        return self._painter

    def open(self, order: LiveOrder) -> None:
        self._here.open(order)

    def change(self, order: LiveOrder) -> None:
        self._here.change(order)

    def close(self) -> None:
        self._here.close()


LiveActor: Actor = RAY.remote(num_cpus=0, max_restarts=0, max_task_retries=0)(_LiveActor)
