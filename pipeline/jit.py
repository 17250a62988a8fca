"""Compilation of serial label work with Numba: cached on disk, without the interpreter lock, strict floating point.

Two faults of Numba's cache are corrected here:

- Its index names a file before that file is written, so a process may load what an older version of the code left
  there. Here only one process at a time compiles or loads, under a file lock that ends with the process; the other
  processes load what the first one compiled.
- It does not notice that a kernel calls a kernel of another file that has changed. Here the cache is also keyed by the
  text of every file that the kernel's file imports, directly or indirectly.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., object])

LOCK = "numba.lock"
"""Name of the lock file beside the cached code."""


def kernel(function: F) -> F:
    """Compile `function` at its first call in a process; equal inputs give equal bytes on every machine."""
    compiled: Any = numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function)
    if hasattr(compiled, "compile"):  # a plain function where compiling is switched off
        compiled.compile = _locked(compiled.compile, Path(compiled.stats.cache_path))
        index = compiled._cache._cache_file
        index._source_stamp = (index._source_stamp, stamp_of(Path(function.__code__.co_filename)))
    return cast(F, compiled)


_ROOT = Path(__file__).parents[1]
_IMPORT = re.compile(r"^from (pipeline[\w.]*) import", re.MULTILINE)


@cache
def stamp_of(file: Path) -> str:
    """SHA-256, hexadecimal, of the file and of every file of the pipeline that it imports, directly or indirectly."""
    digest = hashlib.sha256()
    for each in sorted(_dependencies(file)):
        digest.update(_text(each))
    return digest.hexdigest()


def _dependencies(file: Path) -> set[Path]:
    found, todo = {file}, [file]
    while todo:
        new = _imported(todo.pop()) - found
        found |= new
        todo += new
    return found


@cache
def _imported(file: Path) -> frozenset[Path]:
    named = (_ROOT / name.replace(".", "/") for name in _IMPORT.findall(_text(file).decode()))
    return frozenset(path for name in named if (path := name.with_suffix(".py")).is_file())


@cache
def _text(file: Path) -> bytes:
    return file.read_bytes()


def _locked(compile_for: Callable[P, T], cache: Path) -> Callable[P, T]:
    def compile_locked(*args: P.args, **kwargs: P.kwargs) -> T:
        with _COMPILE_LOCK.acquired(cache):
            return compile_for(*args, **kwargs)

    return compile_locked


class _CompileLock:
    """Lock for compiling and loading: one thread of this process, which then has the lock among processes.

    It is reentrant: a kernel that calls another one compiles it while it is compiled itself, even if the cache of the
    other one is in another folder.
    """

    def __init__(self) -> None:
        self._thread = threading.RLock()
        self._taken = False

    @contextmanager
    def acquired(self, cache: Path) -> Iterator[None]:
        """Context manager that has the lock of the folder `cache`."""
        with self._thread:
            if self._taken:
                yield
                return
            self._taken = True
            handle = _lock_file(cache / LOCK)
            try:
                yield
            finally:
                self._taken = False
                if handle is not None:
                    os.close(handle)


def _lock_file(file: Path) -> int | None:
    """Wait for the lock and return its file descriptor; None where files cannot be locked, such as a read-only file
    system."""
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


_COMPILE_LOCK = _CompileLock()
