"""Resource shortages of a running process: its limits of memory and open files are lowered for a while."""

from __future__ import annotations

import contextlib
import resource
from collections.abc import Iterator

import psutil


@contextlib.contextmanager
def limited(pid: int, which: int, value: int) -> Iterator[None]:
    """The soft limit `which` (resource.RLIMIT_...) of a process is `value` until the block ends."""
    with contextlib.suppress(ProcessLookupError):
        soft, hard = resource.prlimit(pid, which)
        resource.prlimit(pid, which, (min(value, hard) if hard != resource.RLIM_INFINITY else value, hard))
        try:
            yield
        finally:
            with contextlib.suppress(ProcessLookupError):
                resource.prlimit(pid, which, (soft, hard))
        return
    yield


def open_files(pid: int) -> int:
    """Open file descriptors of a process."""
    try:
        return psutil.Process(pid).num_fds()
    except psutil.Error:
        return 0


def address_space(pid: int) -> int:
    """Bytes of address space of a process."""
    try:
        return int(psutil.Process(pid).memory_info().vms)
    except psutil.Error:
        return 0
