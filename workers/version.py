"""Which version of Impasto this is."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed


def version() -> str:
    """As it was installed; "unknown" when it runs from a checkout that nobody installed."""
    try:
        return installed("impasto")
    except PackageNotFoundError:
        return "unknown"
