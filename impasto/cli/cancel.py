"""`impasto cancel`: stop a job at a service."""

from __future__ import annotations

from typing import Annotated

import typer

from impasto.cli.console import emit, say
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of


def cancel(
    job_id: Annotated[str, typer.Argument(metavar="JOB", help="A job's id.")],
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Cancel a job; what is done is kept, and `impasto retry` goes on from there."""
    with client_of(server, api_key) as client:
        job = client.cancel(job_id)
    if as_json:
        emit(job)
    else:
        say(f"{job_id}: {job['state']}")
