"""The Ray actor that answers preview queries: a thin wrapper around plain classes."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import OrderedDict
from collections.abc import Generator
from functools import partial
from typing import TYPE_CHECKING, cast

import ray

from pipeline.errors import Cancelled
from workers.contract.request import Json
from workers.pools.ray_types import CONTROL, RAY, Actor
from workers.previews.model import PreviewQuery, Record
from workers.process.free_memory import limit_free_memory
from workers.process.starting import WARM_UP_THREAD, lower_priority

if TYPE_CHECKING:  # half a second of imports, which only a preview actor needs
    from workers.previews.engine import PreviewEngine

_ENDED_RUNS = 1000
"""Number of ended preview queries that are remembered, since the call that ends one may arrive before the query."""


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
        lower_priority()
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
            raise Cancelled("The client of this preview has left.")

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


PreviewActor: Actor = RAY.remote(num_cpus=0, max_restarts=0, max_task_retries=0, concurrency_groups={CONTROL: 1})(
    _PreviewActor
)
