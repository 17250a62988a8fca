"""Output of the command: results on stdout, everything else on stderr, JSON with `--json`.

Exit status: 0 done, 1 failed, 2 bad input, 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from impasto_client.errors import BY_CODE
from pipeline.errors import BadInput, ImpastoError
from workers.contract.request import Json

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

PIPE_WIDTH = 10_000
"""Characters of a line that is not printed on a terminal."""

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False, soft_wrap=True)


class Interrupted(ImpastoError):
    """Interrupted by Ctrl-C; the work can be resumed."""

    code = "interrupted"


def emit(value: object) -> None:
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
    console = out if out.is_terminal else Console(file=out.file, width=PIPE_WIDTH, highlight=False)
    console.print(rows, crop=out.is_terminal)


def print_status(text: str) -> None:
    """Print a message on stderr: stdout is for results."""
    err.print(text, markup=False)


def print_warnings(warnings: Iterable[Mapping[str, Any]]) -> None:
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


Show = Callable[[Mapping[str, Any]], None]
"""Shows a job, given as the API's JSON object: at least `state`, `progress`, `eta_s` and `steps`."""


@contextmanager
def progress(quiet: bool = False) -> Iterator[Show]:
    """A function that shows a job; call it after each change."""
    if quiet:
        yield lambda job: None
    elif err.is_terminal:
        with _bars() as bars:
            yield _Bars(bars).show
    else:
        yield _Lines().show


def _bars() -> Progress:
    return Progress(
        TextColumn("{task.description}", justify="right"),
        BarColumn(bar_width=36, complete_style="bright_magenta", finished_style="green", pulse_style="magenta"),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("[dim]{task.fields[detail]}"),
        console=err,
    )


class _Bars:
    """A progress bar for each step, and one for the job with the remaining time."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._whole = bars.add_task("[bold]job", total=1.0, detail="")
        self._steps: dict[str, TaskID] = {}

    def show(self, job: Mapping[str, Any]) -> None:
        for step in job["steps"]:
            self._step(step)
        self._bars.update(self._whole, completed=job["progress"], detail=_left(job))

    def _step(self, step: Mapping[str, Any]) -> None:
        bar = self._steps.get(step["name"])
        if bar is None:
            bar = self._steps[step["name"]] = self._bars.add_task(_title(step), total=1.0, start=False, detail="")
        if step["state"] != "waiting":
            self._bars.start_task(bar)
        self._bars.update(bar, completed=step["progress"], detail=_tasks(step))


class _Lines:
    """Output for logs and pipes: one line when a step starts and one when it ends."""

    def __init__(self) -> None:
        self._states: dict[str, str] = {}

    def show(self, job: Mapping[str, Any]) -> None:
        for step in job["steps"]:
            before, now = self._states.get(step["name"], "waiting"), step["state"]
            self._states[step["name"]] = now
            if now != before:
                print_status(f"{_title(step)}: {now}" + (f", {_tasks(step)}" if _tasks(step) else ""))


def _title(step: Mapping[str, Any]) -> str:
    return str(step["title"] or step["name"])


def _tasks(step: Mapping[str, Any]) -> str:
    total = sum(step["counts"].values())
    return f"{step['counts'].get('succeeded', 0)} of {total} tasks" if total > 1 else ""


def _left(job: Mapping[str, Any]) -> str:
    """The remaining time if it is known, else the state."""
    if job["state"] != "running" or job["eta_s"] is None:
        return str(job["state"])
    return f"{duration(job['eta_s'])} left"


def duration(seconds: float) -> str:
    """A duration as text: "8 s", "3 min 20 s", "1 h 05 min"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
