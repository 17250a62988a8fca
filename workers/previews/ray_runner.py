"""Previews on a Ray cluster, whose actors cache the state and do the work instead of the service.

A project is assigned to one actor, which caches its frames, motion and labels. A project gets a new actor while there
are fewer than `most`; otherwise it shares the actor with the fewest projects. One actor without a project is kept ready
for the next project. An actor ends when its projects have sent no query for `idle_s`.

If an actor dies, its projects are assigned to other actors, where queries in progress are repeated. Equal queries give
equal records, except those of progress, so those that the client has received are skipped. The cached state is lost and
computed again.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import cast

import ray
from ray.exceptions import RayError, RayTaskError

from pipeline.errors import Cancelled, ImpastoError
from workers.blobs.base import Blobs
from workers.contract.request import Json
from workers.pools.ray_types import RAY, Actor, ObjectRef
from workers.previews.engine import PreviewEngine
from workers.previews.memory import Check
from workers.previews.model import Overtaken, PreviewQuery, Record
from workers.previews.ray_actor import PreviewActor

log = logging.getLogger(__name__)

CHECK_S = 0.02
"""Interval of checks whether an answer is still needed, seconds."""
LOSSES = 2
"""Number of actors that may die during one query before the query fails."""
STATE_S = 2.0
"""An actor that does not report its state within this time counts without its bytes."""


class PreviewLost(ImpastoError):
    """The processes that painted a preview died, one after the other."""

    code = "worker-lost"


@dataclass(frozen=True)
class PreviewActors:
    """Number, size and lifetime of the preview actors.

    Attributes:
        most: maximum number of actors.
        limit_bytes: maximum size of the cached state of all actors together; each has an equal part.
        threads: number of records that an actor makes at once.
        idle_s: time without a query after which a project is removed from its actor, seconds.
        warms_up: whether a new actor loads the kernels of all methods before they are needed.
    """

    most: int
    limit_bytes: int
    threads: int
    idle_s: float
    warms_up: bool = True


@dataclass(eq=False)
class _PreviewProcess:
    """An actor and the projects that are assigned to it."""

    actor: Actor
    projects: OrderedDict[str, float] = field(default_factory=OrderedDict)
    """Project -> time of its newest query, monotonic s; the oldest first."""
    running: int = 0
    """Number of queries in progress."""


class RayRunner:
    """A `PreviewRunner` over actors. Thread-safe.

    Args:
        blobs: pickled to the actors; several machines must share its folder.
        make_engine: makes an actor's engine with the given limit of bytes; None: a PreviewEngine over `blobs`.
    """

    def __init__(
        self, blobs: Blobs, actors: PreviewActors, make_engine: Callable[[int], PreviewEngine] | None = None
    ) -> None:
        self._limits = actors
        make = partial(make_engine or partial(PreviewEngine, blobs), actors.limit_bytes // actors.most)
        self._make_engine: bytes = RAY.cloudpickle.dumps(make)
        self._workers: list[_PreviewProcess] = []
        self._lock = threading.Lock()
        self._ids = itertools.count(1)
        self._restarts = 0
        self._stopped = threading.Event()
        self._watch = threading.Thread(target=self._end_idle, name="impasto-preview-actors", daemon=True)

    def start(self) -> None:
        """Start the first actor. Ray must be connected, so start the pool first."""
        with self._lock:
            self._keep_spare()
        self._watch.start()

    def run(self, query: PreviewQuery, check: Check) -> Iterator[Record]:
        """The answer, as from `PreviewEngine.run`. Raises PreviewLost if several actors in a row died during the
        query."""
        sent: Counter[tuple[object, ...]] = Counter()
        for _ in range(1 + LOSSES):
            worker = self._enter(query.project)
            try:
                skip = sent.copy()
                for record in self._records(worker.actor, query, check):
                    name = tuple(record.header.get(member) for member in ("type", "frame", "pass", "card"))
                    if skip[name] and name[0] != "progress":
                        skip[name] -= 1
                        continue
                    sent[name] += 1
                    yield record
                return
            except Overtaken as error:
                if not sent:
                    yield Record({"type": "begin", "seq": query.seq})
                yield Record({"type": "overtaken", "by": error.by})
                return
            except RayTaskError:
                raise
            except RayError as error:  # the actor has died, or its record was lost with its machine
                log.warning("a preview actor died: %s", str(error).partition("\n")[0])
                self._lost(worker)
            finally:
                self._leave(worker)
        raise PreviewLost(
            "The process that painted this preview died.", remedy="Change what you ask for, or report it."
        )

    def _records(self, actor: Actor, query: PreviewQuery, check: Check) -> Iterator[Record]:
        """The records of one actor. Raises the query's error, those of `check`, and RayError."""
        run_id = next(self._ids)
        given: PreviewQuery | None = query
        try:
            while True:
                record = _awaited(actor.next_record.remote(run_id, given), check)
                if record is None:
                    return
                given = None
                yield record
        finally:
            actor.end.remote(run_id)

    def _enter(self, project: str) -> _PreviewProcess:
        """The project's actor, with its number of queries increased by one."""
        with self._lock:
            worker = next((worker for worker in self._workers if project in worker.projects), None) or self._assigned()
            worker.projects[project] = time.monotonic()
            worker.projects.move_to_end(project)
            worker.running += 1
            self._keep_spare()
            return worker

    def _assigned(self) -> _PreviewProcess:
        """An actor for a new project: the one with the fewest."""
        self._keep_spare()
        if not self._workers:
            raise Cancelled("The service ends.")
        return min(self._workers, key=lambda worker: len(worker.projects))

    def _keep_spare(self) -> None:
        """Start an actor if each has a project and another one is allowed."""
        if self._stopped.is_set() or len(self._workers) >= self._limits.most:
            return
        if all(worker.projects for worker in self._workers):
            options = PreviewActor.options(max_concurrency=self._limits.threads)
            self._workers.append(_PreviewProcess(options.remote(self._make_engine, self._limits.warms_up)))

    def _leave(self, worker: _PreviewProcess) -> None:
        with self._lock:
            worker.running -= 1

    def _lost(self, worker: _PreviewProcess) -> None:
        with self._lock:
            if worker in self._workers:
                self._workers.remove(worker)
                self._restarts += 1
            self._keep_spare()

    def _end_idle(self) -> None:
        while not self._stopped.wait(min(30.0, self._limits.idle_s / 4)):
            for worker in self._without_use():
                ray.kill(worker.actor)

    def _without_use(self) -> list[_PreviewProcess]:
        """Remove and return the actors whose projects have sent no query for `idle_s`. A spare actor is started if
        there is none."""
        before = time.monotonic() - self._limits.idle_s
        with self._lock:
            idle = []
            for worker in [worker for worker in self._workers if worker.projects and not worker.running]:
                worker.projects = OrderedDict((name, at) for name, at in worker.projects.items() if at > before)
                if not worker.projects:
                    self._workers.remove(worker)
                    idle.append(worker)
            self._keep_spare()
            return idle

    def state(self) -> Json:
        with self._lock:
            asked = [worker.actor.state.remote() for worker in self._workers]
            restarts = self._restarts
        ready, _ = ray.wait(asked, num_returns=len(asked), timeout=STATE_S) if asked else ([], [])
        states = [found for ref in ready if (found := _state(ref)) is not None]
        return {
            "bytes": sum(state["bytes"] for state in states), "limit_bytes": self._limits.limit_bytes,
            "restarts": restarts, "where": "ray", "processes": [state["pid"] for state in states],
        }  # fmt: skip

    def close(self) -> None:
        self._stopped.set()
        with self._lock:
            workers, self._workers = self._workers, []
        for worker in workers:
            ray.kill(worker.actor)


def _awaited(ref: ObjectRef, check: Check) -> Record | None:
    """The answer of an actor. Raises the errors of `check`, which is called meanwhile, and of the actor."""
    while not ray.wait([ref], num_returns=1, timeout=CHECK_S)[0]:
        check()
    try:
        return cast("Record | None", ray.get(ref))
    except RayTaskError as error:  # the actor is alive; our own code has raised the error
        raise error.cause or error from None


def _state(ref: ObjectRef) -> Json | None:
    """An actor's state; None if it has died."""
    try:
        return cast(Json, ray.get(ref))
    except RayError:
        return None
