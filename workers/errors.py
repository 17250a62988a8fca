"""Errors of jobs and stores: those of the tree in `impasto_client.errors` that clients see, and

ImpastoError
├── DamagedBlob                 stored bytes are not those that were stored    500
├── StorageError
│   └── WrongVersion            a worker of another version                 (of an attempt, never answered)
└── NoCapacity                  no machine has what a task needs            (of a task, never answered)
"""

from __future__ import annotations

from impasto_client.errors import (
    Conflict,
    IdempotencyMismatch,
    ImpastoError,
    NotFound,
    QuotaExceeded,
    StorageError,
)

__all__ = [
    "Conflict",
    "DamagedBlob",
    "IdempotencyMismatch",
    "NoCapacity",
    "NotFound",
    "QuotaExceeded",
    "WrongVersion",
]


class WrongVersion(StorageError):
    """A worker of a cluster has another version of the program than the dispatcher. The task waits."""

    code = "wrong-version"


class NoCapacity(ImpastoError):
    code = "no-room"


class DamagedBlob(ImpastoError):
    code = "damaged-storage"
