"""The Ray actors: thin wrappers around plain classes."""

from __future__ import annotations

import contextlib
import gc
import os
import socket
import threading
from collections import OrderedDict
from collections.abc import Callable, Generator, Mapping
from functools import partial
from typing import TYPE_CHECKING, cast

import ray
from ray.exceptions import RayError

from pipeline.errors import Cancelled
from workers.blobs.base import Blobs
from workers.contract.order import TaskOrder, TaskOutcome
from workers.contract.request import Json
from workers.live.channel import Address, LiveWorkerServer
from workers.live.local_workers import SessionRenderer
from workers.live.model import LiveOrder
from workers.pools.artefact_cache import ArtefactCache
from workers.pools.attempt_monitor import AttemptMonitor
from workers.pools.local_pool import TaskRunner
from workers.pools.ray_types import RAY, Actor, ObjectRef
from workers.previews.model import PreviewQuery, Record
from workers.process.free_memory import limit_free_memory
from workers.process.starting import WARM_UP_THREAD

if TYPE_CHECKING:  # half a second of imports, which only a preview actor needs
    from workers.previews.engine import PreviewEngine

CONTROL = "control"
NICENESS = 10
"""Least niceness of processes that render and of threads that load kernels, so that frames of live sessions and the
service's answers go first. Ray adds 15 on nodes where RAY_worker_niceness is not 0."""
FETCH_S = 10.0
"""Beyond this size, the blob store is faster."""
_ENDED_RUNS = 1000
"""Number of ended preview queries that are remembered, since the call that ends one may arrive before the query."""


def _lower_priority() -> None:
    """Raise the niceness of this thread, and of threads that it starts, to `NICENESS`."""
    thread = threading.get_native_id()
    with contextlib.suppress(OSError):  # Linux sets the priority of a thread; other systems may refuse
        os.setpriority(os.PRIO_PROCESS, thread, max(NICENESS, os.getpriority(os.PRIO_PROCESS, thread)))


class _RenderActor:
    """Runs one order at a time; another thread answers queries about its progress."""

    def __init__(self, make_runner: Callable[[Blobs], TaskRunner], blobs: Blobs) -> None:
        _lower_priority()
        limit_free_memory()
        self._monitor = AttemptMonitor()
        self._cache = ArtefactCache(blobs)
        self._runner = make_runner(self._cache)
        warm_up = partial(self._runner.warm_up, lambda: False)
        threading.Thread(target=warm_up, name=WARM_UP_THREAD, daemon=True).start()

    def run(
        self, order: TaskOrder, given: Mapping[str, ObjectRef]
    ) -> tuple[TaskOutcome, dict[str, tuple[ObjectRef, int]]]:
        """Run an order.

        Args:
            given: blob key -> reference to an artefact of an earlier order.

        Returns:
            The outcome; and the artefacts that other tasks of the step will load: blob key -> (reference, number of
            bytes).
        """
        self._cache.begin({key: partial(_fetch, reference) for key, reference in given.items()}, order.leads)
        outcome = self._monitor.run(self._runner, order)
        return outcome, {key: (ray.put(data), len(data)) for key, data in self._cache.end().items()}

    @ray.method(concurrency_group=CONTROL)
    def hello(self) -> tuple[str, str]:
        """Identity of the actor (host and process id), and the id of its Ray node."""
        return f"{socket.gethostname()}:{os.getpid()}", ray.get_runtime_context().get_node_id()

    @ray.method(concurrency_group=CONTROL)
    def progress(self) -> tuple[str, float, str, int]:
        """See `AttemptMonitor.progress`. Also answered while the attempt hangs in Python."""
        return self._monitor.progress()

    @ray.method(concurrency_group=CONTROL)
    def cancel(self, attempt_id: str) -> None:
        self._monitor.cancel(attempt_id)


def _fetch(reference: ObjectRef) -> bytes | None:
    """The bytes of an artefact; None if they were lost with the actor that stored them."""
    try:
        return cast(bytes, ray.get(reference, timeout=FETCH_S))
    except (RayError, TimeoutError):
        return None


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
        _lower_priority()
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


class _PreviewActor:
    """Answers preview queries from its own cached state, one record per call.

    Args:
        make_engine: pickled; makes a `PreviewEngine`.
        warms_up: load the kernels of all methods in a thread of its own, at a low priority.
    """

    def __init__(self, make_engine: bytes, warms_up: bool) -> None:
        limit_free_memory()
        self._engine = cast("PreviewEngine", ray.cloudpickle.loads(make_engine)())
        self._runs: dict[int, Generator[Record]] = {}
        self._ended: OrderedDict[int, None] = OrderedDict()
        if warms_up:
            threading.Thread(target=self._warm_up, name=WARM_UP_THREAD, daemon=True).start()

    def _warm_up(self) -> None:
        _lower_priority()
        self._engine.warm_up()

    def next_record(self, run_id: int, query: PreviewQuery | None) -> Record | None:
        """The next record of a run; None after the last one, and for a run that was ended.

        Args:
            query: starts the run; None: the run has been started.
        """
        if query is not None:
            self._runs[run_id] = self._engine.run(query, partial(self._check, run_id))
        records = self._runs.get(run_id)
        if records is None or run_id in self._ended:
            return None
        try:
            return next(records, None)
        except Cancelled:
            return None
        finally:
            if run_id in self._ended:
                self._close(run_id)

    def _check(self, run_id: int) -> None:
        if run_id in self._ended:
            raise Cancelled("Nobody waits for this preview any more.")

    def _close(self, run_id: int) -> None:
        records = self._runs.get(run_id)
        with contextlib.suppress(ValueError):  # `next_record` is using it, and closes it afterwards
            if records is not None:
                records.close()
                self._runs.pop(run_id, None)

    @ray.method(concurrency_group=CONTROL)
    def end(self, run_id: int) -> None:
        """Stop a run soon, and forget it."""
        self._ended[run_id] = None
        while len(self._ended) > _ENDED_RUNS:
            self._ended.popitem(last=False)
        self._close(run_id)

    @ray.method(concurrency_group=CONTROL)
    def state(self) -> Json:
        """Number of cached bytes, and the process's id."""
        return {"bytes": self._engine.cache.size_bytes, "pid": os.getpid()}


RenderActor: Actor = RAY.remote(max_restarts=0, max_task_retries=0, concurrency_groups={CONTROL: 1})(_RenderActor)
LiveActor: Actor = RAY.remote(num_cpus=0, max_restarts=0, max_task_retries=0)(_LiveActor)
PreviewActor: Actor = RAY.remote(num_cpus=0, max_restarts=0, max_task_retries=0, concurrency_groups={CONTROL: 1})(
    _PreviewActor
)
