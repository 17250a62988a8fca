"""Errors of jobs and stores, on the tree of `pipeline.errors`.

ImpastoError
├── NotFound                    no such job, task, asset, result            404
├── Conflict                    not in this state; or the same key with another body   409 / 422
│   └── IdempotencyMismatch
├── DamagedBlob                 stored bytes are not those that were stored    500
├── StorageError
│   └── WrongVersion            a worker of another version                 (of an attempt, never answered)
├── NoCapacity                      no machine has what a task needs            (of a task, never answered)
└── QuotaExceeded               a key's quota or rate is used up            429
"""

from __future__ import annotations

from pipeline.errors import ImpastoError, StorageError


class NotFound(ImpastoError):
    code = "not-found"


class Conflict(ImpastoError):
    code = "conflict"


class IdempotencyMismatch(Conflict):
    code = "idempotency-mismatch"


class WrongVersion(StorageError):
    """A worker of a cluster has another version of the program than the dispatcher. The task waits."""

    code = "wrong-version"


class NoCapacity(ImpastoError):
    code = "no-room"


class DamagedBlob(ImpastoError):
    code = "damaged-storage"


class QuotaExceeded(ImpastoError):
    code = "quota-exceeded"
