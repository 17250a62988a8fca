"""Errors of jobs and stores, on the tree of `pipeline.errors`.

ImpastoError
├── NotFound                    no such job, task, asset, result            404
├── Conflict                    not in this state; or the same key with another body   409 / 422
│   └── IdempotencyMismatch
├── DamagedBlob                 stored bytes are not those that were stored    500
├── NoCapacity                      no machine has what a task needs            (of a task, never answered)
└── QuotaExceeded               a key's quota or rate is used up            429
"""

from __future__ import annotations

from pipeline.errors import ImpastoError


class NotFound(ImpastoError):
    code = "not-found"


class Conflict(ImpastoError):
    code = "conflict"


class IdempotencyMismatch(Conflict):
    code = "idempotency-mismatch"


class NoCapacity(ImpastoError):
    code = "no-room"


class DamagedBlob(ImpastoError):
    code = "damaged-storage"


class QuotaExceeded(ImpastoError):
    code = "quota-exceeded"
