"""Impasto: video into paintings and cartoons. The command is `impasto`; from Python, `from impasto import Client`."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from impasto.client import Client
    from impasto.live.client import LiveClient

__all__ = ["DEFAULT_SERVER", "Client", "LiveClient", "__version__"]
__version__ = version("impasto")
DEFAULT_SERVER = "http://127.0.0.1:8420"


def __getattr__(name: str) -> object:
    """Import the clients when they are asked for: the command does not need httpx to say its version."""
    if name == "Client":
        from impasto.client import Client

        return Client
    if name == "LiveClient":
        from impasto.live.client import LiveClient

        return LiveClient
    raise AttributeError(f"module 'impasto' has no attribute {name!r}")
