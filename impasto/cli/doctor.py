"""`impasto doctor`: whether this machine can render, and what to do where it cannot."""

from __future__ import annotations

from typing import Annotated

import typer

from impasto.cli.console import FAILED, emit, out
from impasto.cli.options import HomeOption, JsonFlag, home_of

MARKS = {"ok": "[green]ok  [/green]", "warning": "[yellow]warn[/yellow]", "broken": "[red]BAD [/red]"}


def doctor(
    home: HomeOption = None,
    device: Annotated[str, typer.Option(help="The device you would choose: gpu, cpu, or a part of a name.")] = "",
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
