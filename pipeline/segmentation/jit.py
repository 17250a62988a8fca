"""The one way serial label work is compiled: Numba, cached on disk, without the interpreter lock, strict floats.

Numba's cache is not made for several processes at once: its index names a file before that is written, so that another
process may load what an older version of the code has left there. Here one process at a time compiles or loads, under
a lock that dies with it; what the first has compiled the others load.
"""

from __future__ import annotations

import fcntl
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

LOCK = "numba.lock"
"""Name of the lock file beside the cached code."""


def kernel(function: F) -> F:
    """Compile `function` ahead of its first use in a process; equal inputs give equal bytes on every machine."""
    compiled: Any = numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function)
    if hasattr(compiled, "compile"):  # a plain function where compiling is switched off
        compiled.compile = _alone(compiled.compile, Path(compiled.stats.cache_path))
    return cast(F, compiled)


def _alone(compile_for: Callable[..., Any], cache: Path) -> Callable[..., Any]:
    def compile_alone(signature: Any) -> Any:
        with _turn.at(cache):
            return compile_for(signature)

    return compile_alone


class _Turn:
    """Whose turn it is: one thread of this process, which then has the lock among processes.

    A kernel that calls another compiles it in the middle of its own turn, even if its cache is in another folder.
    """

    def __init__(self) -> None:
        self._thread = threading.RLock()
        self._taken = False

    @contextmanager
    def at(self, cache: Path) -> Iterator[None]:
        with self._thread:
            if self._taken:
                yield
                return
            self._taken = True
            handle = _lock(cache / LOCK)
            try:
                yield
            finally:
                self._taken = False
                if handle is not None:
                    os.close(handle)


def _lock(file: Path) -> int | None:
    """Wait for the lock; None where files cannot be locked (a read-only or odd file system)."""
    try:
        handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
    except OSError:
        os.close(handle)
        return None
    return handle


_turn = _Turn()
