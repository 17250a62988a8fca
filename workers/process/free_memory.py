"""Memory that a process has freed goes back to the operating system.

The C library keeps freed memory for later allocations, in up to eight arenas per processor. A thread uses one arena,
and each piece of work has threads of its own, so that free memory collects in all arenas: in a service under mixed load
it grew from 45 to 95 MiB in six minutes while the memory in use stayed the same. `malloc_trim` returns the free pages.
"""

from __future__ import annotations

import ctypes
import threading
from functools import cache

EVERY_S = 60.0


def return_free_memory() -> None:
    """Return the free pages of all arenas to the operating system; nothing where the C library is not glibc."""
    if (trim := getattr(ctypes.CDLL(None), "malloc_trim", None)) is not None:
        trim(ctypes.c_size_t(0))


@cache
def return_free_memory_regularly(every_s: float = EVERY_S) -> None:
    """Do that every `every_s` seconds from now on, in a thread that ends with the process. A second
    call changes nothing."""

    def run() -> None:
        pause = threading.Event()
        while not pause.wait(every_s):
            return_free_memory()

    threading.Thread(target=run, name="impasto-free-memory", daemon=True).start()
