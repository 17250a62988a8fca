"""Impasto turns video into paintings and cartoons.

`impasto.render` stylises frames in this process; `impasto.Client` and `impasto.LiveClient` use a service; the command
is `impasto`.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from impasto.client import Client
    from impasto.library import render
    from impasto.live.client import LiveClient

__all__ = ["DEFAULT_SERVER", "Client", "LiveClient", "__version__", "render"]
__version__ = version("impasto")
DEFAULT_SERVER = "http://127.0.0.1:8420"


def __getattr__(name: str) -> object:
    """Import on first use: `impasto --version` needs neither httpx nor NumPy."""
    if name == "Client":
        from impasto.client import Client

        return Client
    if name == "LiveClient":
        from impasto.live.client import LiveClient

        return LiveClient
    if name == "render":
        from impasto.library import render

        return render
    raise AttributeError(f"module 'impasto' has no attribute {name!r}")
