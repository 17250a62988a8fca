"""`impasto doctor`: whether this machine can render, and how to repair it if not. `impasto version`."""

from __future__ import annotations

import platform
from typing import Annotated

import typer

from impasto import __version__
from impasto.cli.console import FAILED, emit, out
from impasto.cli.options import HomeOption, JsonFlag, home_of

MARKS = {"ok": "[green]ok  [/green]", "warning": "[yellow]warn[/yellow]", "broken": "[red]BAD [/red]"}


def doctor(
    home: HomeOption = None,
    device: Annotated[str, typer.Option(help="An OpenCL device to check: gpu, cpu, or part of a name.")] = "",
    as_json: JsonFlag = False,
) -> None:
    """Check Python, packages, OpenCL devices, codecs, disk and memory.

    Exit status 1 when something that rendering needs is broken.
    """
    from impasto.cli.health import checks

    found = checks(home_of(home), device)
    broken = [check for check in found if check.state == "broken"]
    if as_json:
        emit({"ok": not broken, "checks": [check.as_json() for check in found]})
    else:
        for check in found:
            out.print(f"{MARKS[check.state]} [bold]{check.name}[/bold]", end="  ")
            out.print(check.detail, markup=False)
            if check.remedy and check.state != "ok":
                out.print(f"       {check.remedy}", markup=False)
    if broken:
        raise typer.Exit(FAILED)


def version(as_json: JsonFlag = False) -> None:
    """Print the version of Impasto."""
    if as_json:
        emit({"version": __version__, "python": platform.python_version()})
    else:
        out.print(f"impasto {__version__}")


def print_version(asked: bool) -> None:
    """Callback of `impasto --version`."""
    if asked:
        version()
        raise typer.Exit
