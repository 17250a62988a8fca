"""Runs attempts on a Ray cluster, with one actor per worker. Ray only runs code; its retries and storage are not used.

An actor counts as capacity after it has started, so that a cluster with fewer processors than workers runs fewer tasks
at once. When an actor dies its attempt is reported as lost, and another actor replaces it.

Ray reserves an actor's capacity (processors, part of a GPU, memory), so that no machine is overcommitted. A task that
fits into no idle actor gets a new actor that replaces an idle one. The new actor waits for a machine that is large
enough, because an autoscaler may add one. If no machine of the cluster is large enough, the task's status shows this,
and the task fails after `capacity_wait_s`.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial

import ray
from ray.exceptions import RayError

from pipeline.errors import StorageError
from workers.blobs.base import Blobs
from workers.blobs.disk import DiskBlobs
from workers.contract.order import TaskOrder, TaskOutcome
from workers.contract.request import Json
from workers.errors import NoCapacity
from workers.execution.renderer import remote_renderer
from workers.faults import failed_outcome
from workers.operator_views import Slot
from workers.pools.actors import RenderActor
from workers.pools.artefact_cache import SharedArtefacts
from workers.pools.base import Report
from workers.pools.capacity import (
    Capacity,
    Machines,
    capacity_for,
    default_capacity,
    has_capacity,
    machines_with,
    shortage,
)
from workers.pools.local_pool import Listen, TaskRunner
from workers.pools.ray_cluster import connect
from workers.pools.ray_types import RAY, ObjectRef
from workers.pools.slot_actor import SlotActor
from workers.settings import FarmSettings

log = logging.getLogger(__name__)

_TICK_S = 0.25
"""Interval of progress requests while something runs, seconds."""
_WAIT_S = 3.0
"""Seconds that a starting actor waits before an idle actor is ended for it, if our actors leave no capacity for it."""
_START_S = 60.0
"""The same if they leave enough capacity: then the actor is still starting, or other programs use the cluster."""
_SHARED_BYTES = 64 << 20
"""Maximum bytes of artefacts in Ray's shared memory, over all nodes: far below the amount at which Ray begins to spill
to disk, even with new artefacts. Spilling took a seventh of the time of two processors."""


class RayPool:
    """`settings.most_workers` actors on the cluster at `settings.ray_address` ("local": a cluster on this machine).

    Args:
        blobs: pickled to the actors: S3, or a folder that all machines share.
        make_runner: makes an actor's runner from the blobs; None: a Renderer.
    """

    def __init__(
        self, blobs: Blobs, settings: FarmSettings, make_runner: Callable[[Blobs], TaskRunner] | None = None
    ) -> None:
        self._settings = settings
        self._blobs = blobs
        here = settings.ray_address == "local"
        self._make_runner = make_runner or partial(
            remote_renderer, settings.for_workers, scratch=settings.scratch if here else None
        )
        # A file just written on this machine is read as quickly as shared memory.
        self.shares_memory = not (here and isinstance(blobs, DiskBlobs))
        self._shared = SharedArtefacts(_SHARED_BYTES)
        self._workers: list[SlotActor] = []
        self._lock = threading.RLock()
        self._news = threading.Event()
        self._stopping = False
        self._pump = threading.Thread(target=self._run, name="impasto-ray", daemon=True)
        self._listen: Listen = lambda report: None
        self._usual = default_capacity(settings)
        self._shortage = ""
        """Why no worker can start; empty if one can."""
        self._drained: frozenset[str] = frozenset()
        self._avoided: frozenset[str] = frozenset()
        """Ids of the drained nodes."""
        self._owed = 0
        """Number of idle actors that were ended to free capacity and are to be replaced."""

    @property
    def capacity(self) -> int:
        with self._lock:
            return sum(1 for worker in self._workers if worker.name or worker.attempt_id)

    @property
    def free(self) -> int:
        with self._lock:
            return len(self._idle())

    def _idle(self) -> list[SlotActor]:
        return [worker for worker in self._workers if worker.idle and worker.node not in self._drained]

    def slots(self) -> tuple[Slot, ...]:
        with self._lock:
            there = [worker for worker in self._workers if worker.name]
        return tuple(Slot(w.name, w.node, w.capacity.cpus, w.capacity.gpus, w.capacity.memory_bytes) for w in there)

    def drain(self, nodes: Collection[str]) -> None:
        """Idle actors of these nodes move to others, as far as there is capacity."""
        if self._drained == frozenset(nodes):
            return
        names = _node_names()
        with self._lock:
            self._drained = frozenset(nodes)
            self._avoided = frozenset(node_id for node_id, name in names.items() if name in self._drained)
            for worker in list(self._workers):
                starting = not worker.name and not worker.attempt_id
                if (worker.idle and worker.node in self._drained) or (starting and worker.avoids != self._avoided):
                    self._exchange(worker, self._usual)

    def start(self, listen: Listen) -> None:
        """Connect to a cluster or start one. Call it on the main thread; otherwise Ray aborts the process at its
        end."""
        if threading.current_thread() is not threading.main_thread():
            raise StorageError("A Ray farm starts on the main thread.", remedy="Call start() there.")
        self._listen = listen
        connect(self._settings)
        with self._lock:
            self._workers = [self._new_actor(self._usual) for _ in range(self._settings.most_workers)]
        self._pump.start()

    def submit(self, order: TaskOrder) -> None:
        with self._lock:
            worker = self._place_for(capacity_for(order.resources, self._settings))
            if worker is not None:
                worker.attempt_id = order.attempt_id
                given = self._shared.of(order.artefacts.values()) if order.after else {}
                worker.answer = worker.actor.run.remote(order, given)
        if worker is None:  # an actor died between the claim and now
            self._listen(Report(order.attempt_id, lost=True))
        self._news.set()

    def _place_for(self, capacity: Capacity) -> SlotActor | None:
        idle = self._idle()
        fitting = [worker for worker in idle if worker.capacity.covers(capacity)]
        if fitting or not idle:  # the smallest that suffices: larger ones may be needed for other tasks
            return min(fitting, key=lambda worker: (worker.capacity.gpus, worker.capacity.memory_bytes), default=None)
        suitable = machines_with(capacity, _machines())
        return self._exchange(next((worker for worker in idle if worker.node in suitable), idle[0]), capacity)

    def cancel(self, attempt_id: str) -> None:
        worker = self._at_work(attempt_id)
        if worker is not None:
            worker.actor.cancel.remote(attempt_id)

    def abandon(self, attempt_id: str) -> str:
        worker = self._at_work(attempt_id)
        if worker is None:
            return "no actor runs it"
        ray.kill(worker.actor)
        self._replace(worker)
        return f"the actor {worker.name} was killed"

    def moved_bytes(self, attempt_id: str) -> int:
        return 0  # actors count their bytes as signs of life

    def describe(self) -> dict[str, object]:
        with self._lock:
            busy = {worker.attempt_id: worker.name for worker in self._workers if worker.attempt_id}
        wanted = self._settings.most_workers
        return {"kind": "ray", "workers": self.capacity, "wanted": wanted, "busy": busy, "lacking": self._shortage}

    def stop(self, grace_s: float = 5.0) -> None:
        with self._lock:
            busy = [worker for worker in self._workers if worker.attempt_id]
        for worker in busy:
            worker.actor.cancel.remote(worker.attempt_id)
        if busy:
            ray.wait([worker.answer for worker in busy], num_returns=len(busy), timeout=grace_s)
        self._stopping = True
        self._news.set()
        self._pump.join(grace_s)
        self._collect(0.0)
        ray.shutdown()

    # -- messages of actors: readiness, outcomes, progress

    def _run(self) -> None:
        while not self._stopping:
            self._news.clear()
            try:
                if not self._collect(_TICK_S):
                    self._news.wait(_TICK_S)
                self._ask_progress()
                self._free_capacity()
            except Exception:
                log.exception("the Ray pool failed; it tries again")
                self._news.wait(1.0)

    def _collect(self, timeout_s: float) -> bool:
        """Handle the answers that arrive within `timeout_s`; False at once if none is expected."""
        with self._lock:
            awaited = {w.hello if w.hello is not None else w.answer: w for w in self._workers}
        awaited.pop(None, None)
        if not awaited:
            return False
        come, _ = ray.wait(list(awaited), timeout=timeout_s)
        for ref in come:
            self._take(ref, awaited[ref])
        return True

    def _take(self, ref: ObjectRef, worker: SlotActor) -> None:
        try:
            value = RAY.get(ref)
        except ray.exceptions.RayTaskError as error:  # the actor is alive; our own code has raised the error
            value = failed_outcome(worker.attempt_id, error.cause or error), {}
        except RayError as error:
            log.warning("the worker %s has died: %s", worker.name or "(starting)", type(error).__name__)
            self._replace(worker, lost=worker.attempt_id)
            return
        if worker.hello is None:
            self._answered(worker, *value)
        else:
            self._greeted(worker, *value)

    def _greeted(self, worker: SlotActor, name: str, node_id: str) -> None:
        node = _node_names().get(node_id, node_id[:12])
        with self._lock:
            worker.name, worker.node, worker.hello, worker.too_large_since = name, node, None, None
        self._listen(Report("", worker=name))

    def _answered(self, worker: SlotActor, outcome: TaskOutcome, made: dict[str, tuple[ObjectRef, int]]) -> None:
        self._shared.add(made)
        with self._lock:
            worker.attempt_id, worker.answer = "", None
            if worker.node in self._drained:
                self._exchange(worker, self._usual)
        self._listen(Report(outcome.attempt_id, 1.0, outcome, worker=worker.name))

    def _ask_progress(self) -> None:
        with self._lock:
            busy = [worker for worker in self._workers if worker.attempt_id]
            asked = {worker.actor.progress.remote(): worker for worker in busy if worker.name}
        for worker in busy:
            if not worker.name:  # its actor waits for capacity, which does not count as silence
                none = "" if worker.too_large_since is None else ": no machine has that"
                self._listen(Report(worker.attempt_id, worker=f"waiting for {worker.capacity}{none}"))
        if not asked:
            return
        come, _ = ray.wait(list(asked), num_returns=len(asked), timeout=_TICK_S)
        for ref in come:
            self._report_progress(ref, asked[ref])

    def _report_progress(self, ref: ObjectRef, worker: SlotActor) -> None:
        try:
            attempt_id, done, preview, signs = ray.get(ref)
        except RayError:
            return  # the outcome will report the error
        if attempt_id == worker.attempt_id and signs != worker.signs:
            worker.signs = signs
            self._listen(Report(attempt_id, done, worker=worker.name, preview=preview))

    # -- actors

    def _free_capacity(self) -> None:
        """End idle actors for actors that have waited for capacity; start them again once none waits."""
        now = time.monotonic()
        with self._lock:
            starting = [worker for worker in self._workers if not worker.name]
            if not any(worker.attempt_id for worker in starting):
                self._workers += [self._new_actor(self._usual) for _ in range(self._owed)]
                self._owed = 0
            late = [worker for worker in starting if now - worker.waiting_since > _WAIT_S]
        machines = _machines() if late else []
        for worker in late:
            worker.waiting_since = now
            self._check_waiting(worker, machines, now)
        if not starting or late:
            self._update_shortage(machines)

    def _check_waiting(self, worker: SlotActor, machines: Machines, now: float) -> None:
        """Free capacity for a waiting actor, or fail its attempt if no machine is large enough."""
        suitable = machines_with(worker.capacity, machines)
        if suitable:
            worker.too_large_since = None
            with self._lock:
                named = [(other.node, other.capacity) for other in self._workers if other.name]
            starts = now - worker.made_at < _START_S and has_capacity(worker.capacity, machines, named)
            if worker.attempt_id and not starts:
                self._end_idle(suitable)
            return
        worker.too_large_since = worker.too_large_since or now
        if worker.attempt_id and now - worker.too_large_since > self._settings.capacity_wait_s:
            self._give_up(worker, machines)

    def _give_up(self, worker: SlotActor, machines: Machines) -> None:
        """Fail the attempt of an actor that has waited too long for a machine that does not exist."""
        remedy = "Add such a machine to the cluster, or choose a smaller video, then retry the job."
        error = NoCapacity(
            f"{shortage(worker.capacity, machines)}.", field="needs", value=str(worker.capacity), remedy=remedy
        )
        attempt_id, worker.attempt_id = worker.attempt_id, ""
        ray.kill(worker.actor)
        self._replace(worker)
        self._listen(Report(attempt_id, outcome=failed_outcome(attempt_id, error), worker="none"))

    def _update_shortage(self, machines: Machines) -> None:
        """Log once for operators when no worker can start on any machine."""
        with self._lock:
            none_fits = bool(self._workers) and all(worker.too_large_since is not None for worker in self._workers)
        message = f"{shortage(self._usual, machines)}: no worker can start." if none_fits else ""
        if message and not self._shortage:
            log.warning("%s", message)
        self._shortage = message

    def _end_idle(self, nodes: Collection[str]) -> None:
        """One of these nodes, or None."""
        with self._lock:
            found = next((worker for worker in self._idle() if worker.node in nodes), None)
            if found is not None:
                ray.kill(found.actor)
                self._workers.remove(found)
                self._owed += 1

    def _new_actor(self, capacity: Capacity) -> SlotActor:
        elsewhere = {"ray.io/node-id": f"!in({','.join(sorted(self._avoided))})"} if self._avoided else None
        actor = RenderActor.options(
            num_cpus=capacity.cpus,
            num_gpus=capacity.gpus,
            memory=capacity.memory_bytes or None,
            label_selector=elsewhere,
        ).remote(self._make_runner, self._blobs)
        return SlotActor(actor, actor.hello.remote(), capacity, self._avoided)

    def _exchange(self, worker: SlotActor, capacity: Capacity) -> SlotActor:
        """End an idle actor; another one replaces it."""
        ray.kill(worker.actor)
        new = self._new_actor(capacity)
        self._workers[self._workers.index(worker)] = new
        return new

    def _replace(self, worker: SlotActor, lost: str = "") -> None:
        with self._lock:
            if worker in self._workers:
                self._workers[self._workers.index(worker)] = self._new_actor(self._usual)
        if lost:
            self._listen(Report(lost, lost=True, worker=worker.name))

    def _at_work(self, attempt_id: str) -> SlotActor | None:
        with self._lock:
            return next((worker for worker in self._workers if worker.attempt_id == attempt_id), None)


def _node_names() -> dict[str, str]:
    """Names of Ray's nodes by id: the name given at the start, else the host name."""
    return {node["NodeID"]: _node_name(node) for node in RAY.nodes()}


def _node_name(node: Mapping[str, Json]) -> str:
    named = node["NodeName"] and node["NodeName"] != node["NodeManagerAddress"]
    return str(node["NodeName"] if named else node["NodeManagerHostname"])


def _machines() -> list[tuple[str, Capacity]]:
    """Total capacity of each live node."""
    return [(_node_name(node), _has(node["Resources"])) for node in RAY.nodes() if node["Alive"]]


def _has(resources: Mapping[str, float]) -> Capacity:
    return Capacity(resources.get("CPU", 0.0), resources.get("GPU", 0.0), int(resources.get("memory", 0)))
