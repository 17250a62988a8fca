"""CPU time and peak memory of an attempt, for reports and estimates."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil

from workers.contract.order import CPU, PEAK_MEMORY

_CLEAR_REFS, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
_RESET_PEAK = "5"


class AttemptUsage:
    """Filled in when the attempt has ended."""

    cpu_s = 0.0
    """CPU seconds of this process while the attempt ran, divided equally among concurrent attempts. Decoders of
    untrusted files run in processes of their own and are not counted."""
    peak_bytes = 0
    """Largest resident memory of this process while the attempt ran, bytes."""

    def measures(self) -> dict[str, float]:
        return {CPU: round(self.cpu_s, 6), PEAK_MEMORY: float(self.peak_bytes)}


class ProcessMeter:
    """Divides the CPU time of this process among the attempts that run in it. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: list[AttemptUsage] = []
        self._settled_s = 0.0

    @contextmanager
    def attempt(self) -> Iterator[AttemptUsage]:
        usage = AttemptUsage()
        with self._lock:
            self._settle()
            if not self._running:
                _reset_peak()
            self._running.append(usage)
        try:
            yield usage
        finally:
            with self._lock:
                self._settle()
                self._running.remove(usage)
            usage.peak_bytes = _peak_bytes()

    def _settle(self) -> None:
        now_s = time.process_time()
        for usage in self._running:
            usage.cpu_s += (now_s - self._settled_s) / len(self._running)
        self._settled_s = now_s


METER = ProcessMeter()
"""Measures the usage of this process."""


def _reset_peak() -> None:
    with suppress(OSError):  # another system, or not allowed: the peak is that since the start of the process
        _CLEAR_REFS.write_text(_RESET_PEAK)


def _peak_bytes() -> int:
    try:
        line = next(line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
    except (OSError, StopIteration):  # no Linux
        return int(psutil.Process().memory_info().rss)
    return 1024 * int(line.split()[1])
