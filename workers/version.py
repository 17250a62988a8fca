"""The version of Impasto."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed


def version() -> str:
    """Version of the installed package; "unknown" in a checkout that is not installed."""
    try:
        return installed("impasto")
    except PackageNotFoundError:
        return "unknown"
