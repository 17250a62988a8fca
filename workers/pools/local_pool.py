"""Runs attempts on this machine. Each worker of the pool is a thread that waits for one runner.

The runner of a service is a child process (`workers.pools.child_runner`), because a thread cannot be ended when a
library hangs in it. `impasto render` runs its first attempts in its own threads, which start at once, and ends the
whole process instead.
"""

from __future__ import annotations

import logging
import queue
import socket
import threading
import time
from bisect import insort
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Protocol

from pipeline.methods import method
from workers.contract.order import ProgressReport, TaskOrder, TaskOutcome
from workers.faults import failed_outcome
from workers.jobs.state_machine import ASSEMBLE
from workers.operator_views import Slot
from workers.pools.base import Report
from workers.pools.machine import Machine
from workers.process.starting import WARM_UP_THREAD
from workers.process.vital_signs import diagnose_hang, moved_bytes

log = logging.getLogger(__name__)

_STOP_CHECK_S = 0.2
"""Interval at which an attempt that waits for memory checks whether it was stopped, seconds."""
_REPORT_S = 10.0
"""Interval of reports of an attempt that waits for memory, seconds: without them it would count as lost."""

Listen = Callable[[Report], None]


class TaskRunner(Protocol):
    """Runs one order at a time, as `workers.execution.renderer.Renderer` does."""

    def run(self, order: TaskOrder, report: ProgressReport, cancelled: Callable[[], bool]) -> TaskOutcome: ...

    def close(self) -> None: ...

    def warm_up(self, stopped: Callable[[], bool]) -> None:
        """Warm up in the background, in parallel with `run`, until it is done or `stopped`."""
        ...

    @property
    def pid(self) -> int:
        """Process in which it runs orders."""
        ...

    def kill(self) -> None:
        """End an order that hangs, with its process. Called from another thread than `run`."""
        ...


@dataclass(order=True)
class _SlotThread:
    """A thread that runs orders one after another."""

    number: int
    orders: queue.SimpleQueue[TaskOrder | None] = field(default_factory=queue.SimpleQueue, compare=False)
    thread: threading.Thread | None = field(default=None, compare=False)
    runner: TaskRunner | None = field(default=None, compare=False)
    last_attempt: str = field(default="", compare=False)
    """Id of the last attempt, whose artefacts its process may still have in memory."""

    @property
    def name(self) -> str:
        return f"impasto-worker-{self.number}"

    @property
    def alive(self) -> bool:
        return self.thread is not None and self.thread.is_alive()


class LocalPool:
    """A pool of workers. The first one starts with the pool, others when an order finds no idle worker; it goes to the
    first worker that is ready.

    Args:
        make_runner: makes the runner of a worker, whose number is given: 0 for the first.
        workers: maximum number of attempts that run at once.
        machine: admits attempts by the resources that they need; None: always `workers` at once.
        task_memory_bytes: memory of a process with a task that declares no memory.
        close: releases what the runners share, after the last one has ended.
        warm_up: warms up this process, until it is done or its argument returns True; then the first runner is warmed
            up. None: nothing is.
    """

    shares_memory = False
    idle_s = 600.0
    """A worker other than the first that was idle for this long ends, seconds: it keeps a few hundred MB of memory."""

    def __init__(
        self,
        make_runner: Callable[[int], TaskRunner],
        workers: int,
        machine: Machine | None = None,
        task_memory_bytes: int = 1 << 30,
        close: Callable[[], None] = lambda: None,
        warm_up: Callable[[Callable[[], bool]], None] | None = None,
    ) -> None:
        self.capacity = workers
        self._make_runner, self._close, self._warm_up = make_runner, close, warm_up
        self._machine, self._task_memory_bytes = machine, task_memory_bytes
        self._waiting: deque[TaskOrder] = deque()
        self._idle: list[_SlotThread] = []
        """Idle workers in the order in which they get orders."""
        self._stops: dict[str, threading.Event] = {}
        self._busy: dict[str, _SlotThread] = {}
        self._lock = threading.Lock()
        self._workers: list[_SlotThread] = []
        self._stopping = threading.Event()
        self._first_made = threading.Event()
        """Set when the first worker has its runner."""
        self._warming = threading.Thread(target=self._get_ready, name=WARM_UP_THREAD, daemon=True)
        self._listen: Listen = lambda report: None
        self._node = socket.gethostname()
        self._drained = False

    @property
    def free(self) -> int:
        with self._lock:
            slots = 0 if self._drained else self.capacity - len(self._stops)
        return slots if self._machine is None else min(slots, self._machine.free)

    def drain(self, nodes: Collection[str]) -> None:
        self._drained = self._node in nodes

    def slots(self) -> tuple[Slot, ...]:
        return tuple(Slot(_SlotThread(number).name, self._node) for number in range(self.capacity))

    def start(self, listen: Listen) -> None:
        self._listen = listen
        with self._lock:
            self._add_slot()
        self._warming.start()

    def submit(self, order: TaskOrder) -> None:
        with self._lock:
            self._stops[order.attempt_id] = threading.Event()
        if self._machine is not None:
            share = self._machine.share_of(order.resources, task_cpus(order), self._task_memory_bytes)
            self._machine.admit(order.attempt_id, share)
        with self._lock:
            if self._idle:
                self._take_idle(order).orders.put(order)
                return
            self._waiting.append(order)
            if len(self._workers) < self.capacity:
                self._add_slot()

    def _take_idle(self, order: TaskOrder) -> _SlotThread:
        """An idle worker, preferably one whose process has made an artefact that the order loads."""
        makers = {key.rpartition("/")[0].rpartition("/")[2] for key in order.artefacts.values()}
        chosen = next((worker for worker in self._idle if worker.last_attempt in makers), self._idle[0])
        self._idle.remove(chosen)
        return chosen

    def cancel(self, attempt_id: str) -> None:
        with self._lock:
            if stop := self._stops.get(attempt_id):
                stop.set()

    def abandon(self, attempt_id: str) -> str:
        with self._lock:
            worker = self._busy.get(attempt_id)
            runner = None if worker is None else worker.runner
        if runner is None:
            return ""
        found = diagnose_hang(runner.pid)
        with self._lock:
            if self._busy.get(attempt_id) is worker:  # it has not ended in the meantime
                runner.kill()
        return found

    def moved_bytes(self, attempt_id: str) -> int:
        with self._lock:
            worker = self._busy.get(attempt_id)
        return 0 if worker is None or worker.runner is None else moved_bytes(worker.runner.pid)

    def describe(self) -> dict[str, object]:
        with self._lock:
            busy = {attempt_id: worker.name for attempt_id, worker in self._busy.items()}
        return {"kind": "local", "workers": self.capacity, "busy": busy}

    def stop(self, grace_s: float = 5.0) -> None:
        self._stopping.set()
        with self._lock:
            for stop in self._stops.values():
                stop.set()
            threads = [worker.thread for worker in self._workers if worker.thread is not None]
            for worker in self._workers:
                worker.orders.put(None)
        deadline = time.monotonic() + grace_s
        for thread in (*threads, self._warming):
            thread.join(max(0.0, deadline - time.monotonic()))
        self._close()

    def _get_ready(self) -> None:
        """Warm up this process, then the first worker, which loads from the cache what this process has compiled."""
        if self._warm_up is None:
            return
        self._warm_up(self._stopping.is_set)
        self._first_made.wait()
        runner = self._workers[0].runner
        if runner is not None:
            runner.warm_up(self._stopping.is_set)

    def _add_slot(self) -> None:
        """Start a worker, which takes orders once its runner is made. The caller has the lock."""
        numbers = {worker.number for worker in self._workers}
        worker = _SlotThread(next(number for number in range(self.capacity) if number not in numbers))
        self._workers.append(worker)
        worker.thread = threading.Thread(target=self._work, args=(worker,), name=worker.name, daemon=True)
        worker.thread.start()

    def _offer(self, worker: _SlotThread) -> None:
        """Give a worker the next order that waits, or make it idle."""
        with self._lock:
            if self._waiting:
                worker.orders.put(self._waiting.popleft())
            else:
                insort(self._idle, worker)

    def _work(self, worker: _SlotThread) -> None:
        try:
            worker.runner = self._make_runner(worker.number)
        except Exception:  # the first order will report it
            log.warning("A worker process could not be started.", exc_info=True)
        self._first_made.set()
        self._offer(worker)
        while (order := self._next_order(worker)) is not None:
            self._run(order, worker)
            worker.last_attempt = order.attempt_id
            self._offer(worker)
        if worker.runner is not None:
            worker.runner.close()

    def _next_order(self, worker: _SlotThread) -> TaskOrder | None:
        """Wait for the next order. None: the worker shall end, because the pool ends or the worker was idle for
        long."""
        try:
            return worker.orders.get(timeout=self.idle_s if worker.number else None)
        except queue.Empty:
            with self._lock:
                if worker not in self._idle:
                    return worker.orders.get()  # an order has just come
                self._idle.remove(worker)
                self._workers.remove(worker)
            return None

    def _run(self, order: TaskOrder, worker: _SlotThread) -> None:
        """Run one order and report. A runner that raises is replaced before the next order."""
        attempt_id, name = order.attempt_id, worker.name
        with self._lock:
            stop = self._stops[attempt_id]
            self._busy[attempt_id] = worker
        self._listen(Report(attempt_id, worker=name))

        def report_progress(done: float, preview: str = "") -> None:
            self._listen(Report(attempt_id, done, worker=name, preview=preview))

        try:
            self._wait_for_memory(attempt_id, name, stop)
            worker.runner = worker.runner or self._make_runner(worker.number)
            outcome = worker.runner.run(order, report_progress, stop.is_set)
        except BaseException as error:
            outcome = failed_outcome(attempt_id, error)
            failed, worker.runner = worker.runner, None
            if failed is not None:
                failed.close()
        if self._machine is not None:
            self._machine.release(attempt_id)
        with self._lock:
            del self._stops[attempt_id], self._busy[attempt_id]
        self._listen(Report(attempt_id, 1.0, outcome, worker=name))

    def _wait_for_memory(self, attempt_id: str, name: str, stop: threading.Event) -> None:
        """Wait until the machine admits the attempt, or it is stopped; meanwhile report to the dispatcher that it is
        alive."""
        reported_s = time.monotonic()
        while self._machine is not None and not stop.is_set() and not self._machine.wait(attempt_id, _STOP_CHECK_S):
            if time.monotonic() - reported_s > _REPORT_S:
                reported_s = time.monotonic()
                self._listen(Report(attempt_id, worker=f"{name} (waits for memory)"))


def task_cpus(order: TaskOrder) -> float:
    """Number of processors that the task keeps busy, as it or its method declares; 1 for the platform's own steps."""
    if order.resources is not None and order.resources.cpus is not None:
        return order.resources.cpus
    return 1.0 if order.step == ASSEMBLE else method(order.method).task_cpus
