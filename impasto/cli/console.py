"""How the command speaks: results on stdout, everything else on stderr, JSON where a script asked for it.

Exit status: 0 done, 1 failed, 2 bad input, 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import json
from typing import Any

import typer
from rich.console import Console

from impasto.problems import BY_CODE
from pipeline.errors import BadInput, ImpastoError

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)


class Interrupted(ImpastoError):
    """Ctrl-C, with work that can be taken up again."""

    code = "interrupted"


def emit(value: Any) -> None:
    """Print `value` as one line of JSON on stdout."""
    typer.echo(json.dumps(value, allow_nan=False))


def say(text: str) -> None:
    """Tell a person something, on stderr, so that stdout stays for results."""
    err.print(text, markup=False)


def fail(error: ImpastoError, as_json: bool) -> int:
    """Print an error: one line on stderr, and with `--json` an object on stdout. Returns the exit status."""
    log = getattr(error, "log", "")
    if log:
        typer.echo(log, err=True)
    typer.echo("error: " + " ".join(str(error).split()), err=True)
    if as_json:
        emit({"error": describe(error)})
    return status(error)


def describe(error: ImpastoError) -> dict[str, Any]:
    """An error as JSON: code, message, field, value, remedy."""
    return {
        "code": error.code,
        "message": error.message,
        "field": error.field,
        "value": error.value,
        "remedy": error.remedy,
    }


def status(error: ImpastoError) -> int:
    """The exit status for an error."""
    if isinstance(error, Interrupted):
        return INTERRUPTED
    return BAD_INPUT if issubclass(BY_CODE.get(error.code, type(error)), BadInput) else FAILED
