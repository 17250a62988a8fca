"""Compilation of serial label work with Numba: cached on disk, without the interpreter lock, strict floating point.

Numba keeps compiled code beside its source, so that every installation and every checkout compiles anew, which takes
about a minute. It does not notice that a kernel calls a kernel of another file that has changed. And its index names a
file before that file is written, so that a process may load what an older version of the code left there.

Here compiled code is in the user's cache folder (in NUMBA_CACHE_DIR if that is set), in a folder that is named after
the text of the kernel's file and of every file that this one imports, directly or indirectly: whoever has the same text
shares it, and a folder never has code of two versions. Only one process at a time compiles or loads the kernels of a
file, under a file lock that ends with the process; the others load what the first one compiled.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core.caching import IndexDataCacheFile, _CacheLocator

from pipeline.compute.runtime import cache_folder

P = ParamSpec("P")
T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., object])

LOCK = "kernels.lock"
"""Name of the lock file in the folder of a file's compiled code."""
UNUSED_DAYS = 60
"""Compiled code that no process has used for so long is deleted."""


def kernel(function: F) -> F:
    """Compile `function` at its first call in a process; equal inputs give equal bytes on every machine."""
    compiled: Any = numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function)
    if hasattr(compiled, "compile"):  # a plain function where compiling is switched off
        file = Path(function.__code__.co_filename)
        folder = compiled_at() / f"{file.stem}-{stamp_of(file)[:24]}"
        _keep_at(folder, compiled._cache)
        compiled.compile = _locked(compiled.compile, folder)
    return cast(F, compiled)


@cache
def compiled_at() -> Path:
    """The folder of all compiled code, which nothing else uses: its old folders are deleted."""
    chosen = getattr(numba.config, "CACHE_DIR", "")
    return Path(chosen) / "impasto-kernels" if chosen else cache_folder() / "kernels"


def _keep_at(folder: Path, cache: Any) -> None:
    """Tell a cache of Numba (`numba.core.caching.Cache`) its folder, whose name is the stamp of the text."""
    cache._impl._locator = _Folder(folder, cache._impl.locator.get_disambiguator())
    cache._cache_path = str(folder)
    cache._cache_file = IndexDataCacheFile(str(folder), cache._impl.filename_base, folder.name)  # type: ignore[no-untyped-call]


class _Folder(_CacheLocator):
    """A folder that is made when something is first compiled into it."""

    def __init__(self, folder: Path, function: str) -> None:
        self._folder, self._function = folder, function

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return self._function


@cache
def _use(folder: Path) -> None:
    """Make the folder, or note that it is still used; delete what has not been used for long. Once in a process."""
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _delete_unused(folder.parent, time.time() - UNUSED_DAYS * 86_400)
        os.utime(folder)
    except OSError:
        return  # a read-only file system: what is there can be loaded


def _delete_unused(parent: Path, before: float) -> None:
    for folder in parent.iterdir():
        if folder.is_dir() and folder.stat().st_mtime < before:
            shutil.rmtree(folder, ignore_errors=True)


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


@cache
def _load_numba() -> None:
    """Load what Numba loads at the first kernel, without scipy.linalg: it takes 0.2 s of CPU time, and only matrix
    products need it. It is an optional part of Numba, which few installations have."""
    if "scipy.linalg" not in sys.modules:
        sys.modules["scipy.linalg"] = None  # type: ignore[assignment]  # its import raises ImportError
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            sys.modules.pop("scipy.linalg", None)


def _locked(compile_for: Callable[P, T], folder: Path) -> Callable[P, T]:
    def compile_locked(*args: P.args, **kwargs: P.kwargs) -> T:
        _use(folder)
        with _COMPILE_LOCK.acquired(folder):
            _load_numba()
            return compile_for(*args, **kwargs)

    return compile_locked


class _CompileLock:
    """Lock for compiling and loading: one thread of this process, which then has the lock among processes.

    It is reentrant: a kernel that calls another one compiles it while it is compiled itself.
    """

    def __init__(self) -> None:
        self._thread = threading.RLock()
        self._taken = False

    @contextmanager
    def acquired(self, folder: Path) -> Iterator[None]:
        """Context manager that has the lock file in `folder`."""
        with self._thread:
            if self._taken:
                yield
                return
            self._taken = True
            handle = _lock_file(folder / LOCK)
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
