"""`impasto jobs`: the newest jobs of a service."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

import typer
from rich.table import Table

from impasto.cli.console import emit, out
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of


def jobs(
    state: Annotated[str | None, typer.Option(help="queued, running, paused, succeeded, failed or cancelled.")] = None,
    method: Annotated[str | None, typer.Option("--method", "-m", help="Only this method's.")] = None,
    limit: Annotated[int, typer.Option(min=1, max=200, help="How many at most.")] = 20,
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """List the newest jobs of a service."""
    with client_of(server, api_key) as client:
        found = client.jobs(state=state, method=method, limit=limit)
    if as_json:
        emit(found)
    else:
        out.print(_table(found))


def _table(found: list[dict[str, Any]]) -> Table:
    table = Table("job", "name", "method", "state", "done", "since", box=None, header_style="bold")
    for job in found:
        since = datetime.fromtimestamp(job["created_at"]).astimezone().strftime("%Y-%m-%d %H:%M")
        request = job["request"]
        table.add_row(job["id"], request["name"], request["method"], job["state"], f"{job['progress']:.0%}", since)
    return table
