"""`impasto render`: one file in, one file out, no service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from impasto.cli import values
from impasto.cli.console import emit, out, say
from impasto.cli.options import (
    HomeOption,
    InputOption,
    JsonFlag,
    MethodOption,
    ParamOption,
    QualityOption,
    QuietFlag,
    SeedOption,
    home_of,
)

EPILOG = """[bold]Examples[/bold]

impasto render clip.mp4 -o cartoon.mp4

impasto render clip.mp4 -o cartoon.mp4 --input reference=great_wave.jpg --param lines=off

impasto render clip.mp4 -o frames/ --seed 7 --workers 2

impasto render photo.jpg -o painted.png

impasto render clip.mp4 -o cartoon.mp4 --artefact svg --json

Ctrl-C keeps what is done: the same command goes on from there. `impasto methods abstraction` explains every parameter.
"""


def render(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A video, an image, or a folder of numbered frames.")],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="OUT", help="A .mp4, .webm, .png or .zip file, or a folder: DIR/.")
    ],
    method: MethodOption = "abstraction",
    param: ParamOption = None,
    extra: InputOption = None,
    artefact: Annotated[
        list[str] | None,
        typer.Option(
            "--artefact",
            "--output-artefact",
            metavar="NAME[=PATH]",
            help="Also keep an artefact, beside OUT or at PATH.",
        ),
    ] = None,
    quality: QualityOption = 20,
    seed: SeedOption = 0,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Tasks at once. Never changes a byte.")] = 1,
    home: HomeOption = None,
    quiet: QuietFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Render IN to OUT on this machine, with a bar for each step."""
    from impasto.cli.delivery import target
    from impasto.cli.materials import plain
    from impasto.cli.progress import progress
    from impasto.cli.rendering import Commission, run
    from workers.model import JobRequest, OutputSpec

    where, artefacts = target(output), values.artefacts(artefact or [])
    spec = OutputSpec(format=where.format, quality=quality, artefacts=tuple(sorted(artefacts)))
    request = JobRequest(method, {}, values.params(param or []), seed, spec, name=plain(source.name))
    order = Commission(request, {"video": source, **values.inputs(extra or [])}, where, artefacts)
    order.check()
    with progress(quiet) as show:
        summary = run(order, workers, home_of(home), show)
    if as_json:
        emit(summary)
        return
    out.print(summary["output"], markup=False)
    say(f"{summary['frames']} frames in {summary['seconds']:.2f} s: {summary['fps']:.1f} frames/s")
