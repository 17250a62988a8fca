"""Freed memory goes back to the operating system."""

from __future__ import annotations

import subprocess
import sys

import pytest

_PROGRAM = """
import sys, time
import numpy as np
import psutil
from workers.process.free_memory import return_free_memory_regularly

rss = psutil.Process().memory_info
blocks = [np.ones(64 * 1024, np.uint8) for _ in range(2048)]  # 128 MiB, each too small for pages of its own
blocks = blocks[::64]  # one block in 64 stays, so that the heap cannot shrink at its end
kept = rss().rss
if sys.argv[1] == "yes":
    return_free_memory_regularly(0.05)
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
