"""The cache of compiled kernels on disk: its folders, and the loading of kernels from it.

Numba stores compiled code beside its source, so that every installation and checkout compiles again, which takes
about a minute. It does not notice that a kernel calls a kernel of another file that has changed. And its index names a
file before that file is written, so that a process may load what an older version of the code left there.

Here compiled code is in the user's cache folder (in NUMBA_CACHE_DIR if that is set), in a folder that is named after
the text and place of the kernel's file and of every file that this one imports, directly or indirectly: whoever has the
same files shares it, and a folder never has code of two versions.

Numba has no public interface for this. All that we use of its inside is in this file; a test names what a new version
of Numba lacks (`tests/pipeline/kernels/test_kernel_cache.py`).
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.runtime.nrt import rtsys

from pipeline.compute.runtime import cache_folder

UNUSED_DAYS = 60
"""Days after which compiled code that no process has used is deleted."""


@cache
def compiled_at() -> Path:
    """The folder of all compiled code, which nothing else uses: its old folders are deleted."""
    chosen = getattr(numba.config, "CACHE_DIR", "")
    return Path(chosen) / "impasto-kernels" if chosen else cache_folder() / "kernels"


class _Folder(_CacheLocator):
    """The folder of a function's compiled code. It is made when it is first used."""

    def __init__(self, file: Path, line: int) -> None:
        self._folder = compiled_at() / f"{file.stem}-{stamp_of(file)[:24]}"
        self._line = line
        _use(self._folder)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Folder:
        return cls(Path(py_file), py_func.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)


class _CompiledCode(CompileResultCacheImpl):
    """Writes and loads the compiled code of one function."""

    _locator_classes = [_Folder]  # noqa: RUF012


class KernelCache(FunctionCache):
    """Numba's cache of one function, in a folder of ours.

    Numba loads all that it needs to compile (1 s of CPU time for the kernels of abstraction, a quarter of a start)
    before it looks into its cache. Compiled code needs only the runtime library.
    """

    _impl_class = _CompiledCode

    def has(self, sig: Any, target_context: Any) -> bool:
        """Whether the index names compiled code for this signature."""
        return self._index_key(sig, target_context.codegen()) in self._cache_file._load_index()  # type: ignore[no-untyped-call]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


def keep_on_disk(compiled: Any, locked: Callable[[Path, bool], AbstractContextManager[None]]) -> None:
    """Make Numba's dispatcher of a function compile and load its code in our folder, under a lock.

    Args:
        locked: context manager that has the lock of a folder; called with the folder and whether others may have it at
            the same time, as they may to load.
    """
    store, compile_for = KernelCache(compiled.py_func), compiled.compile  # type: ignore[no-untyped-call]
    folder = Path(store.cache_path)

    def compile_locked(signature: Any) -> Any:
        with locked(folder, True):
            if store.has(signature, compiled.targetctx):
                return compile_for(signature)
        with locked(folder, False):
            return compile_for(signature)

    compiled._cache, compiled.compile = store, compile_locked


@cache
def _use(folder: Path) -> None:
    """Create the folder or update its time of use, and delete folders that have long been unused. Once per process."""
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _delete_unused(folder.parent, time.time() - UNUSED_DAYS * 86_400)
        os.utime(folder)
    except OSError:
        return  # a read-only file system, from which existing code can be loaded


def _delete_unused(parent: Path, before: float) -> None:
    for folder in parent.iterdir():
        if folder.is_dir() and folder.stat().st_mtime < before:
            shutil.rmtree(folder, ignore_errors=True)


_ROOT = Path(__file__).parents[2]
_IMPORT = re.compile(r"^from (pipeline[\w.]*) import", re.MULTILINE)


@cache
def stamp_of(file: Path) -> str:
    """SHA-256, hexadecimal, of the file and of every file of the pipeline that it imports, directly or indirectly.

    Their places count, too: compiled code names the modules that it needs, and a moved file is another module.
    """
    digest = hashlib.sha256()
    for each in sorted(_dependencies(file)):
        digest.update(os.path.relpath(each, _ROOT).encode())
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
