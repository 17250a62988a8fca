"""Processors and memory of this machine, and the choice of the tasks that run on it at once.

Processors are a soft limit, memory a hard one:

- A task begins while running tasks and live sessions keep fewer processors busy than the machine has. A task counts
with the processors that it keeps busy, including its threads. So no processor is idle while tasks wait. - A task begins
only if the memory that it declares is free. Tasks that do not fit wait in the order of arrival, and no task overtakes
them. - Live sessions come first: tasks get the processors that they leave free. One task may always run, of any size.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import psutil

from pipeline.errors import DeviceError
from pipeline.kernels.processors import container_limit, usable_processors
from pipeline.methods.base import PROCESS_BYTES, Resources

LIVE_CPUS = 2.0
"""Processors that a live session keeps busy: it analyses a frame while it paints the previous one."""
DEVICE_CPUS = 4.0
"""Processors that a task keeps busy whose compute device is a CPU. Its kernels use all processors, all else one or two:
beside others of its kind, processors are not idle between kernels."""
THREADS_HERE = 2
"""Attempts of `impasto render` that run at once in threads of its process, before others get processes of their own:
two threads wait little for the interpreter lock, share decoders, and pass artefacts on in memory."""
UNUSED = 0.25
"""Part of the memory that tasks leave to the system, the service and its caches."""
LEAST_BYTES = 64 << 20
"""Least memory that a task counts with."""


@dataclass(frozen=True)
class Share:
    """Processors and memory of a task."""

    cpus: float
    memory_bytes: int


class Machine:
    """Decides which attempts run. Thread-safe.

    Args:
        cpus: processors for tasks and live sessions.
        memory_bytes: memory for tasks.
    """

    def __init__(self, cpus: float, memory_bytes: int) -> None:
        self.cpus, self.memory_bytes = cpus, memory_bytes
        self.live_sessions: Callable[[], int] = lambda: 0
        """Returns the number of live sessions."""
        self.device_is_cpu: Callable[[], bool] = _device_is_cpu
        """Whether the compute device of tasks is a CPU."""
        self._running: dict[str, Share] = {}
        self._waiting: dict[str, Share] = {}
        self._changed = threading.Condition()

    @property
    def free(self) -> int:
        """Number of attempts of one processor that may be admitted now; 0 while one waits for memory."""
        with self._changed:
            if self._waiting:
                return 0
            idle = self.cpus - LIVE_CPUS * self.live_sessions() - sum(share.cpus for share in self._running.values())
            return max(int(-(-idle // 1)), 0 if self._running else 1)

    def admit(self, attempt_id: str, share: Share) -> None:
        """Add an attempt. It may begin when `wait` returns."""
        with self._changed:
            self._waiting[attempt_id] = share
            self._begin_those_that_fit()

    def wait(self, attempt_id: str, timeout_s: float) -> bool:
        """Wait up to `timeout_s` until the attempt may start; whether it may."""
        with self._changed:
            return self._changed.wait_for(lambda: attempt_id not in self._waiting, timeout_s)

    def release(self, attempt_id: str) -> None:
        """Remove an attempt. Does nothing if it is not there."""
        with self._changed:
            self._running.pop(attempt_id, None)
            self._waiting.pop(attempt_id, None)
            self._begin_those_that_fit()

    def share_of(self, resources: Resources | None, cpus: float, default_bytes: int) -> Share:
        """Processors and memory of a task.

        Args:
            resources: as the task declares them. Their memory includes that of a process, which tasks here share.
            cpus: processors that the method's tasks keep busy.
            default_bytes: memory of a process with a task that declares none.
        """
        if resources is not None and resources.gpus != 0:
            cpus = min(self.cpus, DEVICE_CPUS) if self.device_is_cpu() else self.cpus  # a GPU's memory is for one task
        declared = resources.memory_bytes if resources is not None and resources.memory_bytes else default_bytes
        return Share(cpus, max(LEAST_BYTES, declared - PROCESS_BYTES))

    def _begin_those_that_fit(self) -> None:
        for attempt_id, share in list(self._waiting.items()):
            free = self.memory_bytes - sum(other.memory_bytes for other in self._running.values())
            if self._running and share.memory_bytes > free:
                break
            self._running[attempt_id] = self._waiting.pop(attempt_id)
        self._changed.notify_all()


def max_processes(attempts: int, memory_bytes: int, threads: int = 0) -> int:
    """Number of these attempts that can run at once if each has a process, except those in `threads` of this one.

    Their processes take at most half of the memory. At least one can run."""
    return max(1, min(attempts, threads + memory_bytes // (2 * PROCESS_BYTES)))


def this_machine() -> Machine:
    """The processors and memory that this process may use: those of its container, if it runs in one."""
    memory = min(psutil.virtual_memory().total, _container_bytes())
    return Machine(usable_processors(), max(0, int((1 - UNUSED) * memory) - PROCESS_BYTES))


def _device_is_cpu() -> bool:
    from pipeline.compute.choice import choose  # when a task needs it

    try:
        return choose().kind == "cpu"
    except DeviceError:
        return False


def _container_bytes() -> int:
    limit = container_limit("memory.max")
    return int(limit) if limit.isdecimal() else 1 << 62
