"""Freed memory is returned to the operating system."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

_PROGRAM = """
import sys, time
import numpy as np
import psutil
from workers.process.free_memory import limit_free_memory

rss = psutil.Process().memory_info
blocks = [np.ones(64 * 1024, np.uint8) for _ in range(2048)]  # 128 MiB, each too small for pages of its own
blocks = blocks[::64]  # one block in 64 stays, so that the heap cannot shrink at its end
kept = rss().rss
if sys.argv[1] == "yes":
    limit_free_memory(0.05)
    deadline = time.monotonic() + 30
    while kept - rss().rss < 100 * 2**20 and time.monotonic() < deadline:
        time.sleep(0.01)
else:
    time.sleep(0.2)
print(kept - rss().rss)
"""


def _returned_bytes(regularly: str) -> int:
    done = subprocess.run([sys.executable, "-c", _PROGRAM, regularly], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="malloc_trim is a function of glibc")
def test_freed_memory_between_used_blocks_is_returned() -> None:
    assert _returned_bytes("no") < 10 * 2**20
    assert _returned_bytes("yes") >= 100 * 2**20


_ARENAS = """
import os, sys, threading
import numpy as np
from workers.process.free_memory import limit_free_memory

if sys.argv[1] == "yes":
    limit_free_memory()
everyone = threading.Barrier(4 * (os.cpu_count() or 1) + 1)

def allocate():
    blocks = [np.ones(64 * 1024, np.uint8) for _ in range(4)]
    everyone.wait()
    everyone.wait()

for _ in range(everyone.parties - 1):
    threading.Thread(target=allocate).start()
everyone.wait()
arenas = 0
for line in open("/proc/self/maps"):
    begin, end = (int(address, 16) for address in line.split()[0].split("-"))
    arenas += begin % 2**26 == 0 and end - begin < 2**26 and len(line.split()) == 5  # anonymous, 64 MiB with its rest
everyone.wait()
print(arenas)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="arenas are a matter of glibc")
def test_threads_share_as_many_arenas_as_there_are_processors() -> None:
    def arenas(limited: str) -> int:
        done = subprocess.run([sys.executable, "-c", _ARENAS, limited], capture_output=True, text=True, check=True)
        return int(done.stdout)

    assert arenas("yes") <= max(2, os.cpu_count() or 1) < arenas("no")


_KEEPING = """
import resource, sys
import numpy as np
from workers.process.free_memory import keep_free_memory

if sys.argv[1] == "yes":
    keep_free_memory()
np.ones(8 << 20, np.uint8)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.ones(8 << 20, np.uint8)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mallopt is a function of glibc")
def test_large_arrays_reuse_memory_that_is_kept() -> None:
    """An array of 8 MiB has 2048 pages."""
    plain, kept = (
        int(subprocess.run([sys.executable, "-c", _KEEPING, keep], capture_output=True, check=True).stdout)
        for keep in ("no", "yes")
    )
    assert kept < 1000 and kept <= plain
