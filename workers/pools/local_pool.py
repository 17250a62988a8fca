"""Runs attempts in threads of this process, and in child processes beyond the first threads.

NumPy, OpenCV, OpenCL and Numba release Python's interpreter lock, but not all the time: on a machine of many processors
threads would wait for it (`workers.pools.child_runner`).
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
from workers.faults import failed_outcome
from workers.jobs.state_machine import ASSEMBLE
from workers.model import TaskOrder, TaskOutcome
from workers.operations import Slot
from workers.pools.base import Report, Tell
from workers.pools.machine import Machine
from workers.process.starting import WARM_UP_THREAD

log = logging.getLogger(__name__)

_STOP_CHECK_S = 0.2
"""Interval at which an attempt that waits for memory checks whether it was stopped, seconds."""
_REPORT_S = 30.0
"""Interval of reports of an attempt that waits for memory, seconds: without them it would count as lost."""

Listen = Callable[[Report], None]


class TaskRunner(Protocol):
    """Runs one order at a time, as `workers.execution.renderer.Renderer` does."""

    def run(self, order: TaskOrder, report: Tell, cancelled: Callable[[], bool]) -> TaskOutcome: ...

    def close(self) -> None: ...

    def warm_up(self, stopped: Callable[[], bool]) -> None:
        """Warm up in the background, in parallel with `run`, until it is done or `stopped`."""
        ...


@dataclass(order=True)
class _Worker:
    """A thread that runs orders one after another."""

    number: int
    child: bool = field(compare=False)
    """Whether it runs them in a child process."""
    orders: queue.SimpleQueue[TaskOrder | None] = field(default_factory=queue.SimpleQueue, compare=False)
    thread: threading.Thread | None = field(default=None, compare=False)

    @property
    def name(self) -> str:
        return f"impasto-worker-{self.number}"

    @property
    def alive(self) -> bool:
        return self.thread is not None and self.thread.is_alive()


class LocalPool:
    """A pool of threads. Each makes its runner at its first order. An order goes to the first idle thread. If there is
    none, a child process starts for the orders that wait, until all children have started.

    Args:
        make_runner: makes a runner that works in this process.
        workers: maximum number of attempts that run at once.
        children: how many of them run in child processes.
        make_child: makes a runner with a child process.
        machine: admits attempts by the resources that they need; None: always `workers` at once.
        task_memory_bytes: memory of a process with a task that declares no memory.
        close: releases what the runners share, after the last one has ended.
    """

    shares_memory = False
    child_idle_s = 600.0
    """A child process that was idle for this long ends, seconds: it keeps a few hundred MB of memory."""

    def __init__(
        self,
        make_runner: Callable[[], TaskRunner],
        workers: int,
        machine: Machine | None = None,
        task_memory_bytes: int = 1 << 30,
        close: Callable[[], None] = lambda: None,
        children: int = 0,
        make_child: Callable[[], TaskRunner] | None = None,
    ) -> None:
        self.capacity = workers
        self._make_runner, self._close = make_runner, close
        self._unstarted = children
        """Number of child processes that may still be started."""
        self._make_child = make_child or make_runner
        self._machine, self._task_memory_bytes = machine, task_memory_bytes
        self._waiting: deque[TaskOrder] = deque()
        self._idle: list[_Worker] = []
        """Idle workers in the order in which they get orders."""
        self._stops: dict[str, threading.Event] = {}
        self._busy: dict[str, str] = {}
        self._abandoned: set[str] = set()
        self._lock = threading.Lock()
        self._workers: list[_Worker] = []
        self._count = 0
        """Number of workers that were ever added."""
        self._stopping = threading.Event()
        self._warming = threading.Thread(target=self._warm_up, name=WARM_UP_THREAD, daemon=True)
        self._listen: Listen = lambda report: None
        self._node = socket.gethostname()
        self._drained = False

    @property
    def free(self) -> int:
        with self._lock:
            slots = 0 if self._drained else self.capacity - len(self._stops) + len(self._abandoned)
        return slots if self._machine is None else min(slots, self._machine.free)

    def drain(self, nodes: Collection[str]) -> None:
        self._drained = self._node in nodes

    def slots(self) -> tuple[Slot, ...]:
        with self._lock:
            given_up = {self._busy.get(attempt_id) for attempt_id in self._abandoned}
            names = [worker.name for worker in self._workers if worker.alive and worker.name not in given_up]
            names += [f"impasto-worker-{self._count + k}" for k in range(self._unstarted)]  # not started yet
        return tuple(Slot(name, self._node) for name in names)

    def start(self, listen: Listen) -> None:
        self._listen = listen
        for _ in range(self.capacity - self._unstarted):
            self._add_worker(child=False)
        self._warming.start()

    def submit(self, order: TaskOrder) -> None:
        with self._lock:
            self._stops[order.attempt_id] = threading.Event()
        if self._machine is not None:
            share = self._machine.share_of(order.resources, task_cpus(order), self._task_memory_bytes)
            self._machine.admit(order.attempt_id, share)
        with self._lock:
            if self._idle:
                self._idle.pop(0).orders.put(order)
                return
            self._waiting.append(order)
            starts, self._unstarted = self._unstarted > 0, max(0, self._unstarted - 1)
        if starts:
            self._add_worker(child=True)

    def cancel(self, attempt_id: str) -> None:
        with self._lock:
            if stop := self._stops.get(attempt_id):
                stop.set()

    def abandon(self, attempt_id: str) -> None:
        """Give up an attempt that does not answer. A thread cannot be killed, so another one takes its place."""
        self.cancel(attempt_id)
        with self._lock:
            if attempt_id not in self._busy or attempt_id in self._abandoned:
                return
            self._abandoned.add(attempt_id)
            child = any(worker.child for worker in self._workers if worker.name == self._busy[attempt_id])
        self._release(attempt_id)
        self._add_worker(child)

    def describe(self) -> dict[str, object]:
        with self._lock:
            return {"kind": "local", "workers": self.capacity, "busy": dict(self._busy)}

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

    def _warm_up(self) -> None:
        runner = self._make_runner()
        runner.warm_up(self._stopping.is_set)
        runner.close()

    def _add_worker(self, child: bool) -> None:
        with self._lock:
            worker = _Worker(self._count, child)
            self._count += 1
            self._workers.append(worker)
            if not child:  # a child takes orders when it has started
                self._offer(worker)
        worker.thread = threading.Thread(target=self._work, args=(worker,), name=worker.name, daemon=True)
        worker.thread.start()

    def _offer(self, worker: _Worker) -> None:
        """Give a worker the next order that waits, or make it idle. The caller has the lock."""
        if self._waiting:
            worker.orders.put(self._waiting.popleft())
        else:
            insort(self._idle, worker)

    def _work(self, worker: _Worker) -> None:
        runner = self._start_child(worker) if worker.child else None
        while (order := self._next_order(worker)) is not None:
            runner = self._run(order, runner, worker)
            if self._was_abandoned(order.attempt_id):
                break  # another thread has taken this one's place
            with self._lock:
                self._offer(worker)
        if runner is not None:
            runner.close()

    def _start_child(self, worker: _Worker) -> TaskRunner | None:
        """A runner with a child process; None if it cannot be started, which the first order will report."""
        try:
            return self._make_child()
        except Exception:
            log.warning("A worker process could not be started.", exc_info=True)
            return None
        finally:
            with self._lock:
                self._offer(worker)

    def _next_order(self, worker: _Worker) -> TaskOrder | None:
        """Wait for the next order. None: the worker shall end, because the pool ends or its child was idle for long."""
        try:
            return worker.orders.get(timeout=self.child_idle_s if worker.child else None)
        except queue.Empty:
            with self._lock:
                if worker not in self._idle:
                    return worker.orders.get()  # an order has just come
                self._idle.remove(worker)
                self._workers.remove(worker)
                self._unstarted += 1
            return None

    def _was_abandoned(self, attempt_id: str) -> bool:
        with self._lock:
            was = attempt_id in self._abandoned
            self._abandoned.discard(attempt_id)
            return was

    def _run(self, order: TaskOrder, runner: TaskRunner | None, worker: _Worker) -> TaskRunner | None:
        """Run one order and report; returns the runner for the next one."""
        attempt_id, name = order.attempt_id, worker.name
        with self._lock:
            stop = self._stops[attempt_id]
            self._busy[attempt_id] = name
        self._listen(Report(attempt_id, worker=name))

        def tell(done: float, preview: str = "") -> None:
            self._listen(Report(attempt_id, done, worker=name, preview=preview))

        try:
            self._wait_for_memory(attempt_id, name, stop)
            runner = runner or (self._make_child() if worker.child else self._make_runner())
            outcome = runner.run(order, tell, stop.is_set)
        except BaseException as error:
            outcome = failed_outcome(attempt_id, error)
            if runner is not None:
                runner.close()
            runner = None
        self._release(attempt_id)
        with self._lock:
            del self._stops[attempt_id], self._busy[attempt_id]
        self._listen(Report(attempt_id, 1.0, outcome, worker=name))
        return runner

    def _wait_for_memory(self, attempt_id: str, name: str, stop: threading.Event) -> None:
        """Wait until the machine admits the attempt, or it is stopped; meanwhile report to the dispatcher that it is
        alive."""
        reported_s = time.monotonic()
        while self._machine is not None and not stop.is_set() and not self._machine.wait(attempt_id, _STOP_CHECK_S):
            if time.monotonic() - reported_s > _REPORT_S:
                reported_s = time.monotonic()
                self._listen(Report(attempt_id, worker=f"{name} (waits for memory)"))

    def _release(self, attempt_id: str) -> None:
        if self._machine is not None:
            self._machine.release(attempt_id)


def task_cpus(order: TaskOrder) -> float:
    """Number of processors that the task keeps busy, as its method declares; 1 for the platform's own steps."""
    return 1.0 if order.step == ASSEMBLE else method(order.method).task_cpus
