"""Compilation of serial label work with Numba: cached on disk, without the interpreter lock, strict floating point.

A kernel is compiled at its first call, or loaded if it has been compiled before (`kernel_cache.py`). Only one process
at a time compiles the kernels of a file, under a file lock that ends with the process; the others wait, and load what
the first one compiled. Processes load at the same time, under a shared lock.
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

try:
    import fcntl
except ImportError:  # Windows: several processes may compile the same kernels
    fcntl = None  # type: ignore[assignment]

F = TypeVar("F", bound=Callable[..., object])

LOCK = "kernels.lock"
"""Name of the lock file in the folder of a file's compiled code."""


def kernel(function: F) -> F:
    """Compile `function` at its first call in a process; equal inputs give equal bytes on every machine."""
    return cast(F, JitKernel(function))


class JitKernel:
    """A function that is compiled or loaded at its first call.

    Numba itself is imported then, too: that takes 0.4 s of CPU time, and many of our processes call no kernel.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        self._function = function
        self._compiled: Any = None
        self._run: Callable[..., Any] = self._first_run

    def __call__(self, *args: Any) -> Any:
        return self._run(*args)

    def _first_run(self, *args: Any) -> Any:
        self._run = self.compiled
        return self._run(*args)

    @property
    def compiled(self) -> Any:
        """Numba's dispatcher of the function; the function itself where NUMBA_DISABLE_JIT switches compiling off."""
        with _COMPILE_LOCK.of_this_process:
            if self._compiled is None:
                self._compiled = _dispatcher(self._function)
            return self._compiled

    @property
    def _numba_type_(self) -> Any:
        """The type that this has for Numba in a kernel that calls it."""
        return self.compiled._numba_type_


def _dispatcher(function: Callable[..., Any]) -> Any:
    import numba

    from pipeline.kernels.kernel_cache import keep_on_disk

    compiled: Any = numba.njit(nogil=True, fastmath=False, error_model="numpy")(function)
    if compiled is not function:
        keep_on_disk(compiled, _COMPILE_LOCK.acquired)
    return compiled


class _CompileLock:
    """Lock for compiling and loading: one thread of this process, which then has the lock among processes.

    It is reentrant: a kernel that calls another one compiles it while it is compiled itself.
    """

    def __init__(self) -> None:
        self.of_this_process = threading.RLock()
        self._taken = False

    @contextmanager
    def acquired(self, folder: Path, shared: bool) -> Iterator[None]:
        """Context manager that has the lock file in `folder`.

        Args:
            shared: whether others may have it at the same time; without effect in a block that has the lock.
        """
        with self.of_this_process:
            if self._taken:
                yield
                return
            self._taken = True
            handle = _lock_file(folder / LOCK, shared)
            try:
                yield
            finally:
                self._taken = False
                if handle is not None:
                    os.close(handle)


def _lock_file(file: Path, shared: bool) -> int | None:
    """Wait for the lock and return its file descriptor; None where files cannot be locked, such as a read-only file
    system."""
    if fcntl is None:
        return None
    try:
        handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
    except OSError:
        os.close(handle)
        return None
    return handle


_COMPILE_LOCK = _CompileLock()
