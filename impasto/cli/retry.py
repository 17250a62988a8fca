"""`impasto retry`: run again what failed of a job."""

from __future__ import annotations

from typing import Annotated

import typer

from impasto.cli.console import emit, say
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of


def retry(
    job_id: Annotated[str, typer.Argument(metavar="JOB", help="A job's id.")],
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Run again only what failed or was cancelled; what succeeded is kept."""
    with client_of(server, api_key) as client:
        job = client.retry(job_id)
    if as_json:
        emit(job)
    else:
        say(f"{job_id}: {job['state']}; follow it with: impasto watch {job_id}")
