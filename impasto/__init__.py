"""Impasto: video into paintings and cartoons. The command is `impasto`; from Python, `from impasto import Client`."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from impasto.client import Client

__all__ = ["DEFAULT_SERVER", "Client", "__version__"]
__version__ = version("impasto")
DEFAULT_SERVER = "http://127.0.0.1:8420"


def __getattr__(name: str) -> object:
    """Import the client when it is asked for: the command does not need httpx to say its version."""
    if name == "Client":
        from impasto.client import Client

        return Client
    raise AttributeError(f"module 'impasto' has no attribute {name!r}")
