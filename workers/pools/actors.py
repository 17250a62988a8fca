"""The Ray actor that runs attempts: a thin wrapper around plain classes."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import cast

import ray
from ray.exceptions import RayError

from workers.blobs.base import Blobs
from workers.contract.order import TaskOrder, TaskOutcome
from workers.pools.artefact_cache import ArtefactCache
from workers.pools.attempt_monitor import AttemptMonitor
from workers.pools.local_pool import TaskRunner
from workers.pools.ray_types import CONTROL, RAY, Actor, ObjectRef
from workers.process.free_memory import limit_free_memory
from workers.process.starting import WARM_UP_THREAD, lower_priority

FETCH_S = 10.0
"""Beyond this size, the blob store is faster."""


class _RenderActor:
    """Runs one order at a time; another thread answers queries about its progress."""

    def __init__(self, make_runner: Callable[[Blobs], TaskRunner], blobs: Blobs) -> None:
        lower_priority()
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
        self._cache.begin({key: partial(_fetch, reference) for key, reference in given.items()}, order.has_dependents)
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


RenderActor: Actor = RAY.remote(max_restarts=0, max_task_retries=0, concurrency_groups={CONTROL: 1})(_RenderActor)
