"""`impasto batch`: paints the shots of a cut, a manifest or a folder, here or at a service."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from impasto.cli.console import FAILED, describe, emit, out, print_status, progress
from impasto.cli.option_classes import refuse_given, takes_options
from impasto.cli.options import (
    HomeOption,
    JsonFlag,
    KeyOption,
    QuietFlag,
    ServerOption,
    client_of,
    home_of,
)
from pipeline.errors import BadInput

if TYPE_CHECKING:
    from impasto.batch.looks import Config
    from impasto.batch.run import Batch, Plan
    from impasto.batch.shots import Shot
    from impasto_client import Client
    from workers.contract.request import Json

EPILOG = """[bold]Examples[/bold]

impasto batch cut.otio --config looks.toml -o painted/

impasto batch cut.edl --fps 25 --media plates/ --handles 8 -o painted/

impasto batch plates/ --look night.look.json -o painted/

impasto batch shots.csv --server https://impasto.example.org -o painted/

impasto batch incoming/ --watch -o painted/          films that arrive in a folder
"""
POLL_S = 2.0
"""Seconds between looks at a watched folder. A file that changed within that time is still being written."""


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """Options of `impasto batch`."""

    source: Annotated[
        Path,
        typer.Argument(
            metavar="CUT", help="An .otio, .edl, .fcpxml or .xml cut, a .csv or .json manifest, or a folder."
        ),
    ]
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder of the results.")]
    config: Annotated[Path | None, typer.Option(metavar="TOML", help="Looks, names and media: docs/batch.md.")] = None
    look: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A look that the studio has exported, for every shot.")
    ] = None
    media: Annotated[list[Path] | None, typer.Option(help="A folder with media of the cut; repeatable.")] = None
    fps: Annotated[float | None, typer.Option(help="Frame rate of an EDL, or of numbered images of a manifest.")] = None
    handles: Annotated[int | None, typer.Option(min=0, help="Frames before and after each shot.")] = None
    names: Annotated[str | None, typer.Option(help="Names of results, for example {shot}_v{version}.mov.")] = None
    watch: Annotated[bool, typer.Option("--watch", help="Go on: paint what arrives or changes, until Ctrl-C.")] = False
    at_service: Annotated[bool, typer.Option("--at-service", help="Paint at the service, not on this machine.")] = False
    workers: Annotated[int | None, typer.Option(min=1, help="Tasks at once on this machine.")] = None
    home: HomeOption = None
    server: ServerOption = None
    api_key: KeyOption = None
    quiet: QuietFlag = False
    as_json: JsonFlag = False
    given: Mapping[str, str] = field(default_factory=dict)


@takes_options(BatchOptions)
def batch(options: BatchOptions) -> None:
    """Paint the shots of a cut, one film each. What is painted already, by content, is not painted again."""
    from impasto.batch.looks import load_config
    from impasto.batch.run import FPS_FROM_USER

    if options.source.suffix.lower() not in FPS_FROM_USER:
        refuse_given(options.given, ["fps"], "is for EDLs and manifests: other cuts have a rate.", "Leave it out.")
    if options.source.is_dir():
        refuse_given(options.given, ["media"], "is for cuts and manifests.", "Leave it out.")
    if options.at_service or options.server is not None:
        refuse_given(options.given, ["workers"], "is for this machine.", "Leave it out.")
    else:
        refuse_given(options.given, ["api_key"], "is for a service.", "Add --at-service or --server URL.")
    with tempfile.TemporaryDirectory(prefix="impasto-looks-") as scratch:
        config, notes = load_config(options.config, Path(scratch), options.look)
        for note in notes:
            print_status(f"warning: {note}")
        _run(options, config)


def _run(options: BatchOptions, config: Config) -> None:
    from impasto.batch.looks import check_names
    from impasto.batch.run import Batch
    from impasto.cli.private_farm import key_of, workspace

    given: dict[str, Any] = {"handles": options.handles, "names": options.names, "fps": options.fps}
    changes = {name: value for name, value in given.items() if value is not None}
    config = config.model_copy(update={**changes, "media": [*config.media, *(options.media or [])]})
    check_names(config.names)
    output = options.output.expanduser().absolute()
    made = Batch(config, output, options.config.parent if options.config else Path())
    with workspace(home_of(options.home), f"batch-{key_of({'output': output})}"):
        while True:
            rows = _once(options, config, made)
            if not options.watch:
                break
            time.sleep(POLL_S)
    if options.as_json:
        emit({"shots": [_plain(row) for row in rows]})
    if any(row["state"] == "failed" for row in rows):
        raise typer.Exit(FAILED)


def _once(options: BatchOptions, config: Any, made: Batch) -> list[Json]:
    from impasto.batch.run import described, shots_of

    shots = shots_of(options.source.expanduser(), config)
    if options.watch:
        shots = [shot for shot in shots if _is_complete(shot.source)]
    elif options.source.is_dir():
        _tell_of_images(options.source, bool(shots))
    rows = []
    for row in _painted(options, made, shots):
        rows.append(row)
        if not (options.watch and row.pop("known", False)):
            (print_status if row["state"] == "failed" or options.as_json else _print)(described(row))
        for warning in row.get("warnings", ()):
            print_status(f"warning: {row['shot']}: {warning}")
    return rows


def _tell_of_images(folder: Path, has_films: bool) -> None:
    """Say that folders with images are left out. Raises BadInput if the folder has no films."""
    from impasto.batch.shots import images_beside

    others, remedy = ", ".join(images_beside(folder)), "Name folders of images in a manifest: docs/batch.md."
    if not has_films:
        raise BadInput("The folder has no films.", field="CUT", value=folder, remedy=remedy)
    if others:
        print_status(f"warning: Left out, because it is no film: {others}. {remedy}")


def _print(text: str) -> None:
    out.print(text, markup=False)


def _plain(row: Json) -> Json:
    return row | {"error": describe(row["error"])} if "error" in row else row


def _is_complete(path: Path) -> bool:
    return path.exists() and time.time() - path.stat().st_mtime > POLL_S


def _painted(options: BatchOptions, made: Batch, shots: Sequence[Shot]) -> Any:
    if options.at_service or options.server is not None:
        with client_of(options.server, options.api_key) as client:
            yield from made.run(shots, lambda plan: _at_service(client, plan, options.quiet))
    else:
        yield from made.run(shots, lambda plan: _here(plan, options))


def _here(plan: Plan, options: BatchOptions) -> Json:
    from impasto.cli import rendering

    print_status(f"{plan.shot.name}: {plan.where.path.name}")
    order = rendering.RenderOrder(plan.request, plan.paths, plan.where, {}, sequence=plan.shot.sequence)
    with progress(options.quiet) as show:
        return rendering.run(order, options.workers, home_of(options.home), show)


def _at_service(client: Client, plan: Plan, quiet: bool) -> Json:
    """Submit a shot under its key, so that the same one is the same job, wait and fetch it."""
    from impasto.cli.input_files import upload
    from impasto.delivery import deliver
    from pipeline.video.probe import probe

    wanted = plan.request
    frames = {} if wanted.frames is None else {"frames": wanted.frames}
    names = ("format", "quality", "profile", "alpha")
    output = {name: getattr(wanted.output, name) for name in names}
    kept = {name: getattr(wanted, name) for name in ("seed", "name", "labels", "on_damage")}
    more: Any = {**kept, **frames, "output": output}
    inputs = upload(client, plan.paths, sequence=plan.shot.sequence)
    job = client.submit(wanted.method, inputs, wanted.params, idempotency_key=plan.key, **more)
    with progress(quiet) as show:
        for now in client.watch(job["id"]):
            show(now)
    job = client.wait(job["id"])
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        file = client.download(job["id"], Path(scratch) / "file")
        count = probe(file).frames
        deliver(file, plan.where)
    return {"frames": count, "warnings": job["warnings"]}
