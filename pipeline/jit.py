"""The one way serial label work is compiled: Numba, cached on disk, without the interpreter lock, strict floats.

Numba's cache is not made for several processes at once: its index names a file before that is written, so that another
process may load what an older version of the code has left there. Here one process at a time compiles or loads, under
a lock that dies with it; what the first has compiled the others load.

Nor does it see that a kernel calls one of another file that has changed: here what is cached is also stamped with the
text of every file that the kernel's own imports from.
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
        index = compiled._cache._cache_file
        index._source_stamp = (index._source_stamp, stamp_of(Path(function.__code__.co_filename)))
    return cast(F, compiled)


_ROOT = Path(__file__).parents[1]
_IMPORT = re.compile(r"^from (pipeline[\w.]*) import", re.MULTILINE)


@cache
def stamp_of(file: Path) -> str:
    """A digest of the file and, through its imports, of every file of the pipeline that it depends on."""
    digest = hashlib.sha256()
    for each in sorted(_reached(file)):
        digest.update(_text(each))
    return digest.hexdigest()


def _reached(file: Path) -> set[Path]:
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
