"""Impasto turns video into paintings and cartoons.

`impasto.render` stylises frames in this process; `impasto.Client`, `impasto.AsyncClient` and `impasto.LiveClient` use a
service; errors of both are here by name; the command is `impasto`.
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING

from impasto_client import DEFAULT_SERVER
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
    from impasto.library import OutputFile, render
    from impasto.live.client import LiveClient
    from impasto.rendering import MethodNotice, NoEffect
    from impasto.sources import DamagedSource, ImageSequence, SourceFile, SourceNotice
    from impasto_client import AsyncClient, Client

    __version__: str

__all__ = [
    "DEFAULT_SERVER",
    "AsyncClient",
    "BadFrame",
    "BadInput",
    "BadMedia",
    "BadParameter",
    "Cancelled",
    "Client",
    "Conflict",
    "DamagedMedia",
    "DamagedSource",
    "DeviceError",
    "IdempotencyMismatch",
    "ImageSequence",
    "ImpastoError",
    "JobFailed",
    "LiveClient",
    "MediaTooLarge",
    "MethodNotice",
    "NoEffect",
    "NoVideoStream",
    "NotASequence",
    "NotAllowed",
    "NotFound",
    "OutputFile",
    "QuotaExceeded",
    "ServiceUnreachable",
    "SourceFile",
    "SourceNotice",
    "StorageError",
    "StorageFull",
    "UnreadableMedia",
    "__version__",
    "render",
]
_HOMES = {"AsyncClient": "impasto_client", "Client": "impasto_client", "LiveClient": "impasto.live.client"}
_HOMES |= dict.fromkeys(("OutputFile", "render"), "impasto.library")
_HOMES |= dict.fromkeys(("MethodNotice", "NoEffect"), "impasto.rendering")
_HOMES |= dict.fromkeys(("DamagedSource", "ImageSequence", "SourceFile", "SourceNotice"), "impasto.sources")


def __getattr__(name: str) -> object:
    """Import on first use: `import impasto` alone loads neither httpx nor NumPy, and reads no metadata."""
    if name == "__version__":
        from importlib.metadata import version

        return version("impasto")
    if name not in _HOMES:
        raise AttributeError(f"module 'impasto' has no attribute {name!r}")
    return resolve_name(f"{_HOMES[name]}:{name}")


def __dir__() -> list[str]:
    """The public names, for completion in notebooks and editors."""
    return sorted(__all__)
