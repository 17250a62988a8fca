"""The Ray actors, a line or two a method: everything they do is done by plain classes. With `ray_pool`, the only files
that import Ray."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import ray

from workers.local_pool import Runner
from workers.model import TaskOrder, TaskOutcome
from workers.watch import Watch

CONTROL = "control"


class _RenderActor:
    """Runs one order at a time; answers in between, from a thread of its own, how far it is."""

    def __init__(self, make_runner: Callable[[], Runner]) -> None:
        self._watch = Watch()
        self._runner = make_runner()
        warm_up = partial(self._runner.warm_up, lambda: False)
        threading.Thread(target=warm_up, name="impasto-warm-up", daemon=True).start()

    def run(self, order: TaskOrder) -> TaskOutcome:
        return self._watch.run(self._runner, order)

    @ray.method(concurrency_group=CONTROL)
    def hello(self) -> str:
        """Who this is: host and process id."""
        return f"{socket.gethostname()}:{os.getpid()}"

    @ray.method(concurrency_group=CONTROL)
    def progress(self) -> tuple[str, float, str]:
        """(attempt id, 0..1, blob key of its newest frame) of what runs now."""
        return self._watch.progress()

    @ray.method(concurrency_group=CONTROL)
    def cancel(self, attempt_id: str) -> None:
        self._watch.cancel(attempt_id)


RenderActor: Any = cast(Any, ray.remote)(max_restarts=0, max_task_retries=0, concurrency_groups={CONTROL: 1})(
    _RenderActor
)
