"""CPU time and memory of attempts that run in one process."""

from __future__ import annotations

import mmap
import sys
import threading
import time

import numpy as np
import pytest

from workers.execution.usage import AttemptUsage, ProcessMeter


def compute(seconds: float) -> None:
    end_s = time.thread_time() + seconds
    while time.thread_time() < end_s:
        pass


def test_an_attempt_alone_gets_the_cpu_time_of_the_process() -> None:
    meter, before_s = ProcessMeter(), time.process_time()
    with meter.attempt() as usage:
        compute(0.2)
    assert 0.2 <= usage.cpu_s <= time.process_time() - before_s + 0.01
    with meter.attempt() as idle:
        time.sleep(0.05)
    assert idle.cpu_s < 0.2, "the time of earlier attempts is not counted again"


def test_attempts_side_by_side_share_the_cpu_time_of_the_process() -> None:
    meter, found, together = ProcessMeter(), list[AttemptUsage](), threading.Barrier(2)
    before_s = time.process_time()

    def attempt() -> None:
        with meter.attempt() as usage:
            together.wait()
            compute(0.2)
            together.wait()
        found.append(usage)

    threads = [threading.Thread(target=attempt) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    total_s = sum(usage.cpu_s for usage in found)
    assert 0.4 <= total_s <= time.process_time() - before_s + 0.01
    assert all(usage.cpu_s == pytest.approx(total_s / 2, rel=0.2) for usage in found)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux can reset the peak")
def test_the_peak_is_that_of_the_attempt_itself() -> None:
    meter = ProcessMeter()
    with meter.attempt() as large, mmap.mmap(-1, 80_000_000) as memory:  # an allocator may keep what is freed
        memory.write(bytes(len(memory)))
    with meter.attempt() as small:
        np.ones(1_000, np.uint8).sum()
    assert large.peak_bytes - small.peak_bytes > 50_000_000
    assert small.measures()["peak_bytes"] > 0
