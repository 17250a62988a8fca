"""`impasto render`: one file in, one file out, no service."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from impasto.cli import values
from impasto.cli.console import emit, out, print_status, print_warnings
from impasto.cli.options import (
    Damage,
    DamageOption,
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
from pipeline.errors import BadInput

EPILOG = """[bold]Examples[/bold]

impasto render clip.mp4 -o cartoon.mp4

impasto render clip.mp4 -o cartoon.mp4 --input reference=great_wave.jpg --param lines=off

impasto render clip.mp4 -o cartoon.mp4 --overwrite      replaces the file of an earlier render

impasto render clip.mp4 -o frames/ --seed 7 --workers 2

impasto render photo.jpg -o painted.png

ffmpeg -i clip.mov -f yuv4mpegpipe - | impasto render - -o - | ffplay -

impasto render - -o - --raw 640x360@25 < frames.rgb > painted.rgb

impasto render clip.mp4 -o cartoon.mp4 --artefact svg --json

impasto render clip.mp4 -o start.mp4 --frames 0:50

impasto render project.zip -o film.mp4     (a project that a service exported)

Ctrl-C keeps finished tasks: run the same command again to resume. `impasto methods abstraction` lists the parameters.
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
    frames: Annotated[
        str, typer.Option(metavar="FIRST:END", help="Only this piece of IN, counted from 0, END not included.")
    ] = "",
    on_damage: DamageOption = Damage.WARN,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Tasks at once. Never changes a byte.")] = 1,
    raw: Annotated[
        str, typer.Option(metavar="WxH[@FPS]", help="Pipes carry raw RGB frames of this size, not YUV4MPEG2.")
    ] = "",
    home: HomeOption = None,
    quiet: QuietFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Render IN to OUT on this machine, with a bar for each step.

    As IN or OUT, - is a pipe (YUV4MPEG2, or raw RGB with --raw): causal methods write each frame as soon as it is done.
    """
    if "-" in (str(source), output):
        from impasto.cli.piping import PipeOrder

        _check_pipe_options(
            {"--artefact": bool(artefact), "--json": as_json, "--workers": workers != 1, "--frames": bool(frames)}
        )
        inputs = values.inputs(extra or [])
        params = values.params(param or [])
        pipe = PipeOrder(str(source), output, method, params, inputs, seed, quality, overwrite, raw, on_damage.value)
        count = pipe.run()
        print_status(f"{count} frames" if output == "-" else output)
        return
    from impasto.cli.input_files import plain
    from impasto.cli.progress import progress
    from impasto.cli.project import is_project, project_order
    from impasto.cli.rendering import RenderOrder, run
    from impasto.delivery import target
    from workers.model import JobRequest, OutputSpec

    where, artefacts = target(output), values.artefacts(artefact or [])
    spec = OutputSpec(format=where.format, quality=quality, artefacts=tuple(sorted(artefacts)))
    piece = values.frames(frames)
    request = JobRequest(method, {}, values.params(param or []), seed, spec, name=plain(source.name), frames=piece)
    files = RenderOrder(request, {"video": source, **values.inputs(extra or [])}, where, artefacts, overwrite)
    with TemporaryDirectory(prefix="impasto-") as scratch:
        if is_project(source):
            files = project_order(source, Path(scratch), where, artefacts, overwrite, piece)
        files = replace(files, request=replace(files.request, on_damage=on_damage.value))
        files.check()
        with progress(quiet) as show:
            summary = run(files, workers, home_of(home), show)
    print_warnings(summary["warnings"])
    if as_json:
        emit(summary)
        return
    out.print(summary["output"], markup=False)
    print_status(f"{summary['frames']} frames in {summary['seconds']:.2f} s: {summary['fps']:.1f} frames/s")


def _check_pipe_options(given: Mapping[str, bool]) -> None:
    for option, present in given.items():
        if present:
            raise BadInput(
                f"{option} does not work with pipes.", field=option, remedy="Leave it out, or name files as IN and OUT."
            )
