"""The start of a process that imports hundreds of modules and loads kernels."""

from __future__ import annotations

import contextlib
import gc
import os
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

WARM_UP_THREAD = "impasto-warm-up"
"""Name of the thread that loads kernels while the process starts."""


def keep_files_private() -> int:
    """Let only the user of this process read the files that it and its children make from now on; returns the umask of
    before."""
    return os.umask(0o077)


def readable_by_others(folder: Path) -> str:
    """The mode of a folder that other users of the machine can enter or list, such as "755"; "" if there is none."""
    try:
        mode = stat.S_IMODE(folder.stat().st_mode)
    except OSError:
        return ""
    return f"{mode:o}" if mode & 0o077 else ""


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Disables garbage collection during imports and other work whose objects live as long as the process.

    Collections among these objects take a sixth of the CPU time of a start. Afterwards the collector ignores the
    existing objects, because they scarcely ever become garbage, and later collections are short.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


HUNG_STATUS = 75
"""Exit status of a process that has ended itself because an attempt hung in one of its threads (EX_TEMPFAIL)."""

NICENESS = 10
"""Least niceness of processes that render and of threads that load kernels, so that frames of live sessions and the
service's answers go first. Ray adds 15 on nodes where RAY_worker_niceness is not 0."""


def lower_priority() -> None:
    """Raise the niceness of this thread, and of threads that it starts, to `NICENESS`."""
    thread = threading.get_native_id()
    with contextlib.suppress(OSError):  # Linux sets the priority of a thread; other systems may refuse
        os.setpriority(os.PRIO_PROCESS, thread, max(NICENESS, os.getpriority(os.PRIO_PROCESS, thread)))
