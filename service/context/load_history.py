"""Samples of the machine's load over the last hour."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from dataclasses import dataclass

import psutil
from starlette.concurrency import run_in_threadpool

EVERY_S = 10.0
KEPT = 360
"""Samples: an hour."""


@dataclass(frozen=True)
class LoadSample:
    """Load of the machine at a time. All programs count, not only Impasto."""

    at: float
    cpu: float
    """Share of the processors' time that was used since the previous sample, 0..1."""
    memory_bytes: int
    """Memory in use, without caches that the system can release."""


class LoadHistory:
    """Samples of the machine's load."""

    def __init__(self) -> None:
        self._samples: deque[LoadSample] = deque(maxlen=KEPT)
        self._cpu_times = _cpu_times()

    def sample(self) -> None:
        """Add a sample."""
        memory, (busy_s, total_s) = psutil.virtual_memory(), _cpu_times()
        before_busy_s, before_total_s = self._cpu_times
        cpu = (busy_s - before_busy_s) / max(total_s - before_total_s, 1e-9)
        self._cpu_times = busy_s, total_s
        self._samples.append(LoadSample(time.time(), min(1.0, max(0.0, cpu)), memory.total - memory.available))

    @property
    def samples(self) -> tuple[LoadSample, ...]:
        return tuple(self._samples)

    async def run(self) -> None:
        """Take samples until cancelled."""
        while True:
            await run_in_threadpool(self.sample)
            await asyncio.sleep(EVERY_S)


def _cpu_times() -> tuple[float, float]:
    """Busy seconds and total seconds of all processors since the start. (`psutil.cpu_percent` measures since the last
    call of the same thread.)"""
    times = psutil.cpu_times()
    return sum(times) - times.idle - getattr(times, "iowait", 0.0), sum(times)
