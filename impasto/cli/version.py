"""`impasto version`."""

from __future__ import annotations

import platform

from impasto import __version__
from impasto.cli.console import emit, out
from impasto.cli.options import JsonFlag


def version(as_json: JsonFlag = False) -> None:
    """Say which Impasto this is."""
    if as_json:
        emit({"version": __version__, "python": platform.python_version()})
    else:
        out.print(f"impasto {__version__}")
