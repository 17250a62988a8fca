"""Signs of life of a process, seen from outside: bytes that it moves, threads that are busy, stacks of its threads."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import signal
import time

import psutil

STACKS = signal.SIGUSR1
"""Signal at which a process of `show_stacks_on_signal` prints its stacks."""
_SAMPLE_S = 0.5
_BUSY = 0.1
"""Share of a processor from which on a thread counts as spinning; on a busy machine it gets a part of one."""


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
    """Which threads of a process spin. Takes half a second. A process other than this one, which has called
    `show_stacks_on_signal`, prints its stacks."""
    with contextlib.suppress(psutil.Error, OSError):
        before = _cpu_s(pid)
        if pid != os.getpid():
            os.kill(pid, STACKS)
        time.sleep(_SAMPLE_S)
        shares = {thread: (cpu_s - before.get(thread, cpu_s)) / _SAMPLE_S for thread, cpu_s in _cpu_s(pid).items()}
        spinning = [f"thread {t} spins ({share:.0%} of a processor)" for t, share in shares.items() if share > _BUSY]
        return "; ".join(spinning) or "its threads sleep"
    return "its process has ended"


def _cpu_s(pid: int) -> dict[int, float]:
    """CPU seconds of each thread by its id."""
    return {thread.id: thread.user_time + thread.system_time for thread in psutil.Process(pid).threads()}
