"""`impasto watch`: follow a job at a service to its end."""

from __future__ import annotations

from typing import Annotated

import typer

from impasto.cli.console import emit, say
from impasto.cli.options import JsonFlag, KeyOption, QuietFlag, ServerOption, client_of


def watch(
    job_id: Annotated[str, typer.Argument(metavar="JOB", help="A job's id.")],
    server: ServerOption = None,
    api_key: KeyOption = None,
    quiet: QuietFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Show a job's progress until it is over. Ctrl-C stops watching, not the job.

    Exit status 0 means that it succeeded, 1 that it failed or was cancelled.
    """
    from impasto.cli.progress import progress
    from impasto.problems import job_failed

    with client_of(server, api_key) as client, progress(quiet) as show:
        for job in client.watch(job_id):
            show(job)
    if job["state"] != "succeeded":
        raise job_failed(job)
    if as_json:
        emit(job)
    else:
        say(f"succeeded; fetch it with: impasto get {job_id} -o cartoon.mp4")
