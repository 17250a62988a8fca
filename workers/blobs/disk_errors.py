"""Errors of the file system as errors of this package."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.errors import StorageError, StorageFull

_FULL = (errno.ENOSPC, errno.EDQUOT)


@contextmanager
def disk_errors() -> Iterator[None]:
    """Convert OSError to StorageFull or StorageError; FileExistsError and FileNotFoundError pass unchanged."""
    try:
        yield
    except (FileNotFoundError, FileExistsError):
        raise
    except OSError as error:
        if error.errno in _FULL:
            raise StorageFull("The disk of the blobs is full.", remedy="Free some space on it.") from error
        raise StorageError(f"Blobs cannot be read or written: {error}.", remedy="Check the disk.") from error
