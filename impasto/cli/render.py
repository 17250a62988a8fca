"""`impasto render`: one file in, one file out, no service."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli.console import emit, out, print_status, print_warnings, progress
from impasto.cli.options import (
    AlphaOption,
    DamageOption,
    DamagePolicy,
    FieldOrder,
    FieldsOption,
    FormatOption,
    FpsOption,
    HomeOption,
    InputOption,
    JsonFlag,
    LayerOption,
    MethodOption,
    MissingOption,
    OpacityChoice,
    ParamOption,
    PictureOption,
    PremultipliedOption,
    ProfileOption,
    QualityOption,
    QuietFlag,
    SeedOption,
    SoundOption,
    ViewOption,
    artefacts_of,
    frames_of,
    home_of,
    inputs_of,
    params_of,
    sequence_of,
    source_of,
    takes_options,
)
from pipeline.errors import BadInput
from pipeline.method_names import DEFAULT
from workers.process.starting import without_garbage_collection

if TYPE_CHECKING:
    from impasto.cli.rendering import RenderOrder
    from pipeline.video.media import SourceOptions
    from pipeline.video.sequence_options import SequenceOptions

EPILOG = f"""[bold]Examples[/bold]

impasto render clip.mp4 -o cartoon.mp4

impasto render clip.mp4 -o cartoon.mp4 --input reference=great_wave.jpg --param lines=off

impasto render clip.mp4 -o cartoon.mp4 --overwrite      replaces the file of an earlier render

impasto render clip.mp4 -o frames/ --seed 7 --workers 1      one task at a time: less memory

impasto render photo.jpg -o painted.png

impasto render "shot/beauty.####.png" -o painted/ --missing hold --fps 25

ffmpeg -i clip.mov -f yuv4mpegpipe - | impasto render - -o - | ffplay -

impasto render - -o - --raw 640x360@25 < frames.rgb > painted.rgb

impasto render clip.mp4 -o cartoon.mp4 --artefact svg --json

impasto render clip.mp4 -o start.mp4 --frames 0:50

impasto render clip.mov -o painted.mov --profile 4444

impasto render plate.####.png -o "comp/painted.####.tif"

impasto render clip.mp4 --estimate       time, memory and disk space, without rendering

impasto render project.zip -o film.mp4     (a project that a service exported)

Ctrl-C keeps finished tasks: run the same command again to resume. `impasto methods {DEFAULT}` lists the parameters.
"""


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """Options of `impasto render`."""

    source: Annotated[
        Path,
        typer.Argument(metavar="IN", help="A video, an image, a folder of frames, or name.####.png."),
    ]
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            help="A video file, an image, a .zip, a folder DIR/, or DIR/name.####.tif.",
        ),
    ] = ""
    estimate: Annotated[
        bool, typer.Option("--estimate", help="Print the expected time, memory and disk space, and exit.")
    ] = False
    method: MethodOption = DEFAULT
    param: ParamOption = None
    extra: InputOption = None
    artefact: Annotated[
        list[str] | None,
        typer.Option(
            "--artefact",
            "--output-artefact",
            metavar="NAME[=PATH]",
            help="Also save an artefact, beside OUT or at PATH.",
        ),
    ] = None
    output_format: FormatOption = ""
    profile: ProfileOption = ""
    alpha: AlphaOption = OpacityChoice.AUTO
    premultiplied: PremultipliedOption = False
    quality: QualityOption = 20
    seed: SeedOption = 0
    frames: Annotated[
        str, typer.Option(metavar="FIRST:END", help="Render only these frames of IN, from 0, without END.")
    ] = ""
    on_damage: DamageOption = DamagePolicy.WARN
    video_stream: PictureOption = None
    sound_track: SoundOption = None
    fields: FieldsOption = FieldOrder.AUTO
    missing: MissingOption = None
    fps: FpsOption = None
    layer: LayerOption = None
    view: ViewOption = None
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=256, help="Simultaneous tasks; default: as many as fit. The result is the same."),
    ] = None
    raw: Annotated[
        str, typer.Option(metavar="WxH[@FPS]", help="Pipes carry raw RGB frames of this size, not YUV4MPEG2.")
    ] = ""
    home: HomeOption = None
    quiet: QuietFlag = False
    as_json: JsonFlag = False


@takes_options(RenderOptions)
def render(options: RenderOptions) -> None:
    """Render IN to OUT on this machine, with a bar for each step.

    As IN or OUT, - is a pipe (YUV4MPEG2, or raw RGB with --raw): causal methods write each frame as soon as it is done.
    """
    if not options.output and not options.estimate:
        raise BadInput("OUT is missing.", field="--output", remedy="Name the file of the result: -o painted.mp4.")
    if "-" in (str(options.source), options.output):
        _render_pipe(options)
    else:
        _render_file(options)


def _render_pipe(options: RenderOptions) -> None:
    with without_garbage_collection():
        from impasto.cli.piping import PipeOrder

    without_pipes = {
        "--artefact": bool(options.artefact), "--json": options.as_json, "--workers": options.workers is not None,
        "--frames": bool(options.frames), "--estimate": options.estimate, "--sound-track": bool(options.sound_track),
    }  # fmt: skip
    _check_pipe_options(without_pipes)
    pipe = PipeOrder(
        str(options.source), options.output, options.method, params_of(options.param or []),
        inputs_of(options.extra or []), options.seed, options.quality, options.overwrite, options.raw,
        options.on_damage.value, _source(options, None), _sequence(options),
        options.profile, options.alpha.value,
    )  # fmt: skip
    count = pipe.run()
    print_status(f"{count} frames" if options.output == "-" else options.output)


def _render_file(options: RenderOptions) -> None:
    with without_garbage_collection():
        from impasto.cli.rendering import run

    with TemporaryDirectory(prefix="impasto-") as scratch:
        order = _order(options, Path(scratch))
        if options.on_damage is DamagePolicy.FAIL:  # else as an exported project says
            order = replace(order, request=replace(order.request, on_damage=options.on_damage.value))
        order.check()
        if options.estimate:
            _print_estimate(order, home_of(options.home), options.as_json)
            return
        with progress(options.quiet) as show:
            summary = run(order, options.workers, home_of(options.home), show)
    print_warnings(summary["warnings"])
    if options.as_json:
        emit(summary)
        return
    out.print(summary["output"], markup=False)
    print_status(f"{summary['frames']} frames in {summary['seconds']:.2f} s: {summary['fps']:.1f} frames/s")


def _print_estimate(order: RenderOrder, home: Path, as_json: bool) -> None:
    from impasto.cli.estimating import estimate_render

    found = estimate_render(order.request, order.paths["video"], home)
    if as_json:
        emit(found)
        return
    if found["seconds"] is None:
        print_status("Nothing is known of this video: it names neither its frames nor their size.")
        return
    basis = f"{found['samples']} earlier renders" if found["samples"] else "the method's own figures, on one core"
    print_status(
        f"{found['frames']} frames: about {found['seconds']:.0f} s, {found['cpu_s'] or 0:.0f} s of processor time, "
        f"{found['memory_bytes'] / 1e6:.0f} MB memory for each task, {found['disk_bytes'] / 1e6:.0f} MB disk, "
        f"from {basis}."
    )


def _order(options: RenderOptions, scratch: Path) -> RenderOrder:
    """The order for a video or an image, or for the shot of an exported project."""
    from impasto.cli.input_files import plain
    from impasto.cli.project import project_order
    from impasto.cli.rendering import RenderOrder
    from impasto.delivery import target
    from workers.contract.request import JobRequest, OutputSpec
    from workers.projects.archive import is_project

    output = options.output or str(scratch / "estimate.mp4")
    where = target(output, form=options.output_format)
    artefacts, frames = artefacts_of(options.artefact or []), frames_of(options.frames)
    spec = OutputSpec(
        where.format, options.quality, tuple(sorted(artefacts)), profile=options.profile, alpha=options.alpha.value
    )
    request = JobRequest(
        options.method, {}, params_of(options.param or []), options.seed, spec, name=plain(options.source.name),
        frames=frames, source=_source(options, options.sound_track),
    )  # fmt: skip
    paths = {"video": options.source, **inputs_of(options.extra or [])}
    if is_project(options.source):
        return project_order(options.source, scratch, where, artefacts, options.overwrite, frames)
    return RenderOrder(request, paths, where, artefacts, options.overwrite, _sequence(options))


def _source(options: RenderOptions, sound: list[int] | None) -> SourceOptions:
    return source_of(options.video_stream, sound, options.fields, options.premultiplied)


def _sequence(options: RenderOptions) -> SequenceOptions:
    return sequence_of(options.missing, options.fps, options.layer, options.view)


def _check_pipe_options(given: Mapping[str, bool]) -> None:
    for option, present in given.items():
        if present:
            raise BadInput(
                f"{option} does not work with pipes.", field=option, remedy="Leave it out, or name files as IN and OUT."
            )
