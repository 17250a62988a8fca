"""Impasto turns video into paintings and cartoons.

`impasto.render` stylises frames in this process; `impasto.Client` and `impasto.LiveClient` use a service; the command
is `impasto`.
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from impasto.client import Client
    from impasto.library import ImageSequence, OutputFile, SourceFile, render
    from impasto.live.client import LiveClient
    from impasto.settings import DEFAULT_SERVER

    __version__: str

__all__ = [
    "DEFAULT_SERVER",
    "Client",
    "ImageSequence",
    "LiveClient",
    "OutputFile",
    "SourceFile",
    "__version__",
    "render",
]
_HOMES = {
    "DEFAULT_SERVER": "impasto.settings",
    "Client": "impasto.client",
    "ImageSequence": "impasto.library",
    "LiveClient": "impasto.live.client",
    "OutputFile": "impasto.library",
    "SourceFile": "impasto.library",
    "render": "impasto.library",
}


def __getattr__(name: str) -> object:
    """Import on first use: `import impasto` alone loads neither httpx nor NumPy, and reads no metadata."""
    if name == "__version__":
        from importlib.metadata import version

        return version("impasto")
    if name not in _HOMES:
        raise AttributeError(f"module 'impasto' has no attribute {name!r}")
    return resolve_name(f"{_HOMES[name]}:{name}")
