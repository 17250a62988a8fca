"""`impasto get`: fetch the result of a job from a service."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from impasto.cli.console import emit, out
from impasto.cli.options import JsonFlag, KeyOption, ServerOption, client_of
from pipeline.errors import BadInput

if TYPE_CHECKING:
    from impasto.cli.delivery import Target

EPILOG = """[bold]Examples[/bold]

impasto get job_01J... -o cartoon.mp4

impasto get job_01J... -o frames/            a "png" job as numbered frames

impasto get job_01J... --file sheet -o sheet.jpg
"""


def get(
    job_id: Annotated[str, typer.Argument(metavar="JOB", help="A job's id.")],
    output: Annotated[str, typer.Option("--output", "-o", metavar="OUT", help="A file, or a folder: DIR/.")],
    file: Annotated[str, typer.Option(help="result, poster, sheet, preview, or an artefact.")] = "result",
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Fetch a job's result. OUT appears whole or not at all; a broken connection goes on where it stopped."""
    from impasto.cli.delivery import Target, deliver, target

    with client_of(server, api_key) as client:
        job = client.job(job_id)
        where = target(output) if file == "result" else Target(Path(output).expanduser().absolute(), "", "file")
        if file == "result":
            _check(job, where)
        with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
            deliver(client.download(job_id, Path(scratch) / "file", file), where)
    if as_json:
        emit({"job": job_id, "file": file, "output": str(where.path)})
    else:
        out.print(str(where.path), markup=False)


def _check(job: dict[str, Any], where: Target) -> None:
    made = job["request"]["output"]["format"]
    if made != where.format:
        raise BadInput(
            f"The job made {made}, and OUT asks for {where.format}.",
            field="--output",
            value=where.path,
            remedy="Name a .zip file or a folder ending in /." if made == "png" else f"Let OUT end in .{made}.",
        )
