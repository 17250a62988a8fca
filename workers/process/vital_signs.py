"""Signs of life of a process, seen from outside: bytes that it moves, threads that are busy, stacks of its threads."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import threading
import time
from collections import Counter
from pathlib import Path

import psutil

STACKS = signal.SIGUSR1
"""Signal at which a process of `show_stacks_on_signal` prints its stacks."""
_LOOKS, _LOOK_EVERY_S = 10, 0.05
"""How often a process that hangs is looked at, and the time between two looks, seconds."""


def moved_bytes(pid: int) -> int:
    """Bytes that the process has read and written so far, files and pipes; 0 if that is not known."""
    with contextlib.suppress(psutil.Error, AttributeError, OSError):
        counters = psutil.Process(pid).io_counters()
        return int(counters.read_chars + counters.write_chars)
    return 0


def show_stacks_on_signal() -> None:
    """Let this process print the stacks of all its threads on stderr at `STACKS`, also while native code holds the
    interpreter lock."""
    faulthandler.register(STACKS, all_threads=True)


def diagnose_hang(pid: int) -> str:
    """Which threads of a process spin: they run, or wait for a processor, in most looks. Takes half a second. A process
    other than this one, which has called `show_stacks_on_signal`, prints its stacks."""
    with contextlib.suppress(OSError):
        if pid != os.getpid():
            os.kill(pid, STACKS)
        seen: Counter[int] = Counter()
        for _ in range(_LOOKS):
            time.sleep(_LOOK_EVERY_S)
            seen.update(_running(pid))
        spinning = [f"thread {thread} spins" for thread, looks in seen.items() if looks > _LOOKS / 2]
        return "; ".join(spinning) or "its threads sleep"
    return "its process has ended"


def _running(pid: int) -> list[int]:
    """Ids of the threads that run or wait for a processor. Raises OSError if the process has ended."""
    found = []
    for thread in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(OSError):  # the thread has ended
            state = (thread / "stat").read_text().rpartition(")")[2].split()[0]
            if state == "R" and int(thread.name) != threading.get_native_id():
                found.append(int(thread.name))
    return found
