"""Client of an Impasto service: uploads, jobs, events, results, projects.

    from impasto_client import Client

    with Client("http://127.0.0.1:8420") as impasto:
        job = impasto.submit("abstraction", {"video": impasto.upload("clip.mp4")["id"]})
        impasto.wait(job["id"])
        impasto.download(job["id"], "cartoon.mp4")

`AsyncClient` has the same methods as coroutines. Answers are the API's JSON objects, typed in `impasto_client.models`.
Problems are raised as the classes of `impasto_client.errors`.
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING

from impasto_client.defaults import DEFAULT_SERVER, FINAL
from impasto_client.errors import (
    BadFrame,
    BadInput,
    BadMedia,
    BadParameter,
    Cancelled,
    Conflict,
    DamagedMedia,
    DeviceError,
    IdempotencyMismatch,
    ImpastoError,
    JobFailed,
    MediaTooLarge,
    NotAllowed,
    NotASequence,
    NotFound,
    NoVideoStream,
    QuotaExceeded,
    ServiceUnreachable,
    StorageError,
    StorageFull,
    UnreadableMedia,
)

if TYPE_CHECKING:
    from impasto_client._async.client import AsyncClient
    from impasto_client._sync.client import Client

__all__ = [
    "DEFAULT_SERVER",
    "FINAL",
    "AsyncClient",
    "BadFrame",
    "BadInput",
    "BadMedia",
    "BadParameter",
    "Cancelled",
    "Client",
    "Conflict",
    "DamagedMedia",
    "DeviceError",
    "IdempotencyMismatch",
    "ImpastoError",
    "JobFailed",
    "MediaTooLarge",
    "NoVideoStream",
    "NotASequence",
    "NotAllowed",
    "NotFound",
    "QuotaExceeded",
    "ServiceUnreachable",
    "StorageError",
    "StorageFull",
    "UnreadableMedia",
]
_HOMES = {"AsyncClient": "impasto_client._async.client", "Client": "impasto_client._sync.client"}


def __getattr__(name: str) -> object:
    """Import on first use: the errors alone need no HTTP."""
    if name not in _HOMES:
        raise AttributeError(f"module 'impasto_client' has no attribute {name!r}")
    return resolve_name(f"{_HOMES[name]}:{name}")


def __dir__() -> list[str]:
    return sorted(__all__)
