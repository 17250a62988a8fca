"""In-memory files with a path, for libraries that can read only from a path.

A decoder process must not write files (`RLIMIT_FSIZE` is 0); the limit also covers in-memory files. The process
therefore reserves one before it sets the limit, and later copies data into it through a memory map, which is exempt.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_RESERVED_BYTES = 1 << 30
"""Length of the reserved file. The file is sparse: only pages that were written occupy memory."""
_reserved: list[int] = []


def reserve() -> None:
    """Reserve an in-memory file for this process, which `path_of` then uses. No effect if the system lacks
    `memfd_create`."""
    if not _reserved and hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("impasto-reserved")
        os.ftruncate(descriptor, _RESERVED_BYTES)
        _reserved.append(descriptor)


@contextmanager
def path_of(data: bytes, suffix: str) -> Iterator[Path]:
    """Context manager: a path from which `data` can be read. In a reserved file, zero bytes follow the data.

    Not thread-safe in a process that has reserved a file, because the next call replaces its contents.

    Args:
        suffix: file name extension with the dot; used only for files on disk.

    Raises:
        MemoryError: the data is longer than the reserved file.
    """
    if _reserved:
        yield _copied(data, _reserved[0])
    else:
        with tempfile.NamedTemporaryFile(suffix=suffix) as file:
            file.write(data)
            file.flush()
            yield Path(file.name)


def _copied(data: bytes, descriptor: int) -> Path:
    if len(data) > _RESERVED_BYTES:
        raise MemoryError(f"{len(data)} bytes do not fit a file in memory of {_RESERVED_BYTES} bytes")
    with mmap.mmap(descriptor, max(len(data), 1)) as view:
        view[: len(data)] = data
    return Path(f"/proc/self/fd/{descriptor}")
