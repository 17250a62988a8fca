"""`impasto submit`: upload what is new, and hand a job to a service."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli import values
from impasto.cli.console import emit, out, print_status
from impasto.cli.options import (
    Damage,
    DamageOption,
    InputOption,
    JsonFlag,
    KeyOption,
    MethodOption,
    ParamOption,
    QualityOption,
    SeedOption,
    ServerOption,
    client_of,
)
from workers.model import Json

if TYPE_CHECKING:
    from impasto.client import Client

EPILOG = """[bold]Examples[/bold]

job=$(impasto submit clip.mp4 --param lines=off)

impasto watch "$job" && impasto get "$job" -o cartoon.mp4

impasto submit clip.mp4 --webhook https://example.org/hook --label shot=12 --json
"""


def submit(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A video, an image, or a folder of numbered frames.")],
    method: MethodOption = "abstraction",
    param: ParamOption = None,
    extra: InputOption = None,
    output_format: Annotated[str, typer.Option("--format", help="mp4, webm, or png (a zip of frames).")] = "mp4",
    artefact: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Also make an artefact.")] = None,
    quality: QualityOption = 20,
    seed: SeedOption = 0,
    name: Annotated[str, typer.Option(help="Name of the job; else the name of IN.")] = "",
    label: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="A label for searching; repeatable.")
    ] = None,
    on_damage: DamageOption = Damage.WARN,
    priority: Annotated[int, typer.Option(min=-100, max=100, help="Higher goes first.")] = 0,
    webhook: Annotated[str, typer.Option(metavar="URL", help="URL that receives a message when the job ends.")] = "",
    idempotency_key: Annotated[
        str, typer.Option(help="Repeating a request with the same key returns the same job.")
    ] = "",
    server: ServerOption = None,
    api_key: KeyOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Upload IN and submit a job to a service. Prints the job's id."""
    from impasto.cli.input_files import plain

    paths = {"video": source, **values.inputs(extra or [])}
    given = values.params(param or [])
    labels = values.labels(label or [])
    with client_of(server, api_key) as client:
        job = client.submit(
            method,
            _upload(client, paths),
            given,
            seed=seed,
            output={"format": output_format, "quality": quality, "artefacts": artefact or []},
            name=name or plain(source.name),
            labels=labels,
            priority=priority,
            webhook=webhook,
            on_damage=on_damage.value,
            idempotency_key=idempotency_key,
        )
    _tell(job, as_json)


def _upload(client: Client, paths: Mapping[str, Path]) -> dict[str, str]:
    """Input name -> asset id. Files that the service has already are not sent again."""
    from impasto.cli.input_files import gather

    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        files = {name: gather(name, path, Path(scratch)).path for name, path in paths.items()}
        return {name: str(client.upload(file)["id"]) for name, file in files.items()}


def _tell(job: Json, as_json: bool) -> None:
    if as_json:
        emit(job)
        return
    out.print(job["id"], markup=False)
    print_status(f"{job['state']}; follow it with: impasto watch {job['id']}")
