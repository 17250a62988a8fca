"""Progress and cancellation of an attempt, for a thread other than the one that runs it."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict

from workers.contract.order import TaskOrder, TaskOutcome
from workers.pools.local_pool import TaskRunner
from workers.process.vital_signs import moved_bytes

_REMEMBERED = 64
_STEP_BYTES = 1 << 20


class AttemptMonitor:
    """Runs attempts and reports on the current one. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._attempt_id = ""
        self._done = 0.0
        self._preview = ""
        self._reports = 0
        """Number of reports of all attempts."""
        self._cancelled: OrderedDict[str, None] = OrderedDict()

    def run(self, runner: TaskRunner, order: TaskOrder) -> TaskOutcome:
        with self._lock:
            self._attempt_id, self._done, self._preview = order.attempt_id, 0.0, ""
        return runner.run(order, self._report, lambda: self._is_cancelled(order.attempt_id))

    def progress(self) -> tuple[str, float, str, int]:
        """(attempt id, 0..1, blob key of its newest frame) of the latest attempt; and a number that grows while it
        reports or its process moves bytes."""
        moved = moved_bytes(os.getpid()) // _STEP_BYTES
        with self._lock:
            return self._attempt_id, self._done, self._preview, self._reports + moved

    def cancel(self, attempt_id: str) -> None:
        """Stop the attempt, also if it has not begun yet."""
        with self._lock:
            self._cancelled[attempt_id] = None
            while len(self._cancelled) > _REMEMBERED:
                self._cancelled.popitem(last=False)

    def _report(self, done: float, preview: str = "") -> None:
        with self._lock:
            self._done, self._preview, self._reports = done, preview or self._preview, self._reports + 1

    def _is_cancelled(self, attempt_id: str) -> bool:
        with self._lock:
            return attempt_id in self._cancelled
