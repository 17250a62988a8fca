"""Output of the command: results on stdout, everything else on stderr, JSON with `--json`.

Exit status: 0 done, 1 failed, 2 bad input, 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import typer
from rich.console import Console
from rich.table import Table

from impasto.problems import BY_CODE
from pipeline.errors import BadInput, ImpastoError
from workers.model import Json

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

PIPE_WIDTH = 10_000
"""Characters of a line that is not printed on a terminal."""

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)


class Interrupted(ImpastoError):
    """Ctrl-C; the work can be resumed."""

    code = "interrupted"


def emit(value: Any) -> None:
    """Print `value` as one line of JSON on stdout."""
    typer.echo(json.dumps(value, allow_nan=False))


def table(*columns: str) -> Table:
    """An empty table in the command's style. The first column holds ids, which are never cut."""
    found = Table(box=None, header_style="bold")
    for index, column in enumerate(columns):
        found.add_column(column, no_wrap=index == 0, overflow="ignore" if index == 0 else "fold")
    return found


def print_table(rows: Table) -> None:
    """Print a table: fitted to a terminal; with unlimited lines into a pipe or file, so that nothing is cut."""
    if out.is_terminal:
        out.print(rows)
    else:
        out.print(rows, width=PIPE_WIDTH, crop=False)


def print_status(text: str) -> None:
    """Print a message on stderr: stdout is for results."""
    err.print(text, markup=False)


def print_warnings(warnings: Iterable[Json]) -> None:
    """Print the warnings of a job on stderr, a line each."""
    for warning in warnings:
        print_status(f"warning: {warning['message']}")


def fail(error: ImpastoError, as_json: bool) -> int:
    """Print an error: one line on stderr, and with `--json` an object on stdout. Returns the exit status."""
    log = getattr(error, "log", "")
    if log:
        typer.echo(log, err=True)
    for one in (error, *error.others):
        typer.echo("error: " + " ".join(str(one).split()), err=True)
    if as_json:
        emit({"error": describe(error)})
    return status(error)


def describe(error: ImpastoError) -> Json:
    """An error as JSON: code, message, field, value, remedy; `others`: further errors of the same request."""
    found: Json = {
        "code": error.code,
        "message": error.message,
        "field": error.field,
        "value": error.value,
        "remedy": error.remedy,
    }
    return found | ({"others": [describe(other) for other in error.others]} if error.others else {})


def status(error: ImpastoError) -> int:
    """The exit status for an error."""
    if isinstance(error, Interrupted):
        return INTERRUPTED
    return BAD_INPUT if issubclass(BY_CODE.get(error.code, type(error)), BadInput) else FAILED
