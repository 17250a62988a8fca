"""`impasto render`: one file in, one file out, no service."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from impasto.cli.console import emit, out, print_status, print_warnings, progress
from impasto.cli.option_classes import refuse_given, takes_options
from impasto.cli.options import (
    AlphaOption,
    ColourInOption,
    ColourOutOption,
    ColourViewOption,
    DamageOption,
    DamagePolicy,
    FieldOrder,
    FieldsOption,
    FormatOption,
    FpsOption,
    FramesOption,
    HomeOption,
    InputOption,
    JsonFlag,
    LayerOption,
    MethodOption,
    MissingOption,
    OpacityChoice,
    OverwriteFlag,
    ParamOption,
    PassesFormatOption,
    PassesOption,
    PictureOption,
    PremultipliedOption,
    ProfileOption,
    QualityOption,
    QuietFlag,
    SeedOption,
    SoundOption,
    VectorsOption,
    ViewOption,
    artefacts_of,
    frames_of,
    home_of,
    inputs_of,
    params_of,
    passes_of,
    sequence_of,
    source_of,
)
from pipeline.errors import BadInput
from pipeline.method_names import DEFAULT
from workers.process.starting import without_garbage_collection

if TYPE_CHECKING:
    from impasto.cli.rendering import RenderOrder
    from pipeline.video.sequence_options import SequenceOptions
    from workers.contract.request import Json

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

impasto render clip.mp4 -o cartoon.mp4 --passes flow,labels --passes-to passes/

impasto render clip.mp4 -o start.mp4 --frames 0:50

impasto render clip.mov -o painted.mov --profile 4444

impasto render plate.####.png -o "comp/painted.####.tif"

impasto render clip.mp4 --estimate       time, memory and disk space, without rendering

impasto render clip.mp4 --explain        tasks, critical path, and time on 1 to 64 processors

impasto render project.zip -o film.mp4      all shots of a project that a service exported, joined with sound

impasto render project.zip -o shot.mp4 --shot 2

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
    explain: Annotated[
        bool,
        typer.Option(
            "--explain", help="Print the plan, its critical path, and the expected time on 1 to 64 processors; exit."
        ),
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
    passes: PassesOption = ""
    passes_format: PassesFormatOption = ""
    passes_to: Annotated[
        str,
        typer.Option(
            metavar="PATH",
            help="Where the passes are saved: a .zip, a folder DIR/, or DIR/name.#### with the extension "
            "of their format; default: beside OUT.",
        ),
    ] = ""
    output_format: FormatOption = ""
    profile: ProfileOption = ""
    alpha: AlphaOption = OpacityChoice.AUTO
    premultiplied: PremultipliedOption = False
    colour_in: ColourInOption = ""
    colour_view: ColourViewOption = ""
    colour_out: ColourOutOption = ""
    quality: QualityOption = 20
    seed: SeedOption = 0
    frames: FramesOption = ""
    shot: Annotated[
        int | None, typer.Option(min=1, help="Number of the only shot of a project that is rendered; default: all.")
    ] = None
    on_damage: DamageOption = DamagePolicy.WARN
    video_stream: PictureOption = None
    sound_track: SoundOption = None
    fields: FieldsOption = FieldOrder.AUTO
    missing: MissingOption = None
    fps: FpsOption = None
    layer: LayerOption = None
    view: ViewOption = None
    vectors: VectorsOption = None
    overwrite: OverwriteFlag = False
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
    given: Mapping[str, str] = field(default_factory=dict)


@takes_options(RenderOptions)
def render(options: RenderOptions) -> None:
    """Render IN to OUT on this machine, with a bar for each step.

    As IN or OUT, - is a pipe (YUV4MPEG2, or raw RGB with --raw): causal methods write each frame as soon as it is done.
    """
    if not options.output and not options.estimate and not options.explain:
        raise BadInput("OUT is missing.", field="--output", remedy="Name the file of the result: -o painted.mp4.")
    if "-" in (str(options.source), options.output):
        _render_pipe(options)
    else:
        _render_file(options)


def _render_pipe(options: RenderOptions) -> None:
    with without_garbage_collection():
        from impasto.cli.piping import PipeOrder

    refuse_given(
        options.given, _NO_PIPE, "does not work with pipes.", "Leave it out, or name files as IN and OUT.",
    )  # fmt: skip
    if str(options.source) == "-":
        names = (*_OF_FILES, "fields") if options.raw else _OF_FILES
        refuse_given(options.given, names, "is for files: frames of a pipe are as they are.", "Leave it out.")
    if options.output == "-":
        refuse_given(options.given, _OF_FILMS, "is for files: a pipe gets plain frames.", "Leave it out.")
    pipe = PipeOrder(
        str(options.source), options.output, options.method, params_of(options.param or []),
        inputs_of(options.extra or []), options.seed, options.quality, options.overwrite, options.raw,
        options.on_damage.value, source_of(options), _sequence(options),
        options.profile, options.alpha.value,
    )  # fmt: skip
    count = pipe.run()
    print_status(f"{count} frames" if options.output == "-" else options.output)


def _render_file(options: RenderOptions) -> None:
    with without_garbage_collection():
        from impasto.cli.rendering import run
        from workers.projects.archive import is_project

    refuse_given(options.given, ["raw"], "is for pipes.", "Leave it out, or name - as IN or OUT.")
    if options.explain:
        refuse_given(options.given, ["estimate"], "and --explain are two questions.", "Ask one after the other.")
    home = home_of(options.home)
    with TemporaryDirectory(prefix="impasto-") as scratch:
        if is_project(options.source):
            _render_project(options, Path(scratch))
            return
        if options.shot is not None:
            raise BadInput("IN is no project, so that it has no shots.", field="--shot", value=options.shot,
                           remedy="Leave --shot out, or name the zip of an exported project.")  # fmt: skip
        order = _damage_policy(options, _order(options, Path(scratch)))
        order.check()
        if options.explain:
            _print_explanation(order, home_of(options.home), options.as_json)
            return
        if options.estimate:
            _print_estimate([order], home, options.as_json)
            return
        with progress(options.quiet) as show:
            summary = run(order, options.workers, home, show)
    _print_summary(options, summary)


def _render_project(options: RenderOptions, scratch: Path) -> None:
    from impasto.cli.project import project_orders
    from impasto.cli.project_film import run_film
    from impasto.delivery import passes_target, target
    from impasto.ranges import span_of
    from workers.contract.request import OutputSpec

    refuse_given(options.given, _OF_SHOTS, "is for videos: a project has its own.",
                 "Change the project and export it again, or leave the option out.")  # fmt: skip
    wanted = OutputSpec(passes=passes_of(options.passes), passes_format=options.passes_format)
    where = target(options.output or str(scratch / "estimate.mp4"), form=options.output_format)
    artefacts, span = artefacts_of(options.artefact or []), span_of(options.frames)
    film = project_orders(options.source, scratch, where, artefacts, options.overwrite, span, options.shot, wanted)
    shots = tuple(
        replace(_damage_policy(options, order), passes_to=passes_target(options.passes_to, order.request.output))
        for order in film.shots
    )
    film = replace(film, shots=shots)
    film.check()
    if options.explain:
        if len(shots) > 1:
            raise BadInput("--explain is for one shot.", field="--explain", remedy="Add --shot N.")
        _print_explanation(shots[0], home_of(options.home), options.as_json)
        return
    if options.estimate:
        _print_estimate(film.shots, home_of(options.home), options.as_json)
        return
    _print_summary(options, run_film(film, options.workers, home_of(options.home), options.quiet))


def _damage_policy(options: RenderOptions, order: RenderOrder) -> RenderOrder:
    """The order with `--on-damage`, if that is given; else the order keeps the setting of the exported project."""
    if "on_damage" not in options.given:
        return order
    return replace(order, request=replace(order.request, on_damage=options.on_damage.value))


def _print_summary(options: RenderOptions, summary: Json) -> None:
    print_warnings(summary["warnings"])
    if options.as_json:
        emit(summary)
        return
    out.print(summary["output"], markup=False)
    print_status(f"{summary['frames']} frames in {summary['seconds']:.2f} s: {summary['fps']:.1f} frames/s")


def _print_estimate(orders: Sequence[RenderOrder], home: Path, as_json: bool) -> None:
    """Print what the renders need one after the other."""
    from impasto.cli.estimating import estimate_render, summed
    from impasto.cli.rendering import gathered

    with TemporaryDirectory(prefix="impasto-") as scratch:
        found = summed([
            estimate_render(order.request, gathered(order, Path(scratch))["video"].path, home) for order in orders
        ])  # fmt: skip
    if as_json:
        emit(found)
        return
    if found["seconds"] is None:
        print_status("Nothing is known of this video: it names neither its frames nor their size.")
        return
    count = found["samples"]
    basis = f"{count} earlier render{'s' if count > 1 else ''}" if count else "the method's own figures, on one core"
    print_status(
        f"{found['frames']} frames: about {found['seconds']:.0f} s, {found['cpu_s'] or 0:.0f} s of processor time, "
        f"{found['memory_bytes'] / 1e6:.0f} MB memory for each task, {found['disk_bytes'] / 1e6:.0f} MB disk, "
        f"from {basis}."
    )


def _print_explanation(order: RenderOrder, home: Path, as_json: bool) -> None:
    from impasto.cli import explaining

    explanation, samples = explaining.explain_render(order, home)
    if as_json:
        emit(explaining.as_json(explanation, samples))
    else:
        out.print(explaining.as_text(explanation, samples), markup=False, highlight=False)


def _order(options: RenderOptions, scratch: Path) -> RenderOrder:
    """The order for a video or an image."""
    from impasto.cli.input_files import plain
    from impasto.cli.rendering import RenderOrder
    from impasto.delivery import passes_target, target
    from workers.contract.request import JobRequest, OutputSpec

    output = options.output or str(scratch / "estimate.mp4")
    where, sequence = target(output, form=options.output_format), _sequence(options)
    artefacts, frames = artefacts_of(options.artefact or []), frames_of(options.frames, options.source, sequence)
    spec = OutputSpec(
        where.format, options.quality, tuple(sorted(artefacts)), profile=options.profile, alpha=options.alpha.value,
        colour=options.colour_out, passes=passes_of(options.passes), passes_format=options.passes_format,
    )  # fmt: skip
    request = JobRequest(
        options.method, {}, params_of(options.param or []), options.seed, spec, name=plain(options.source.name),
        frames=frames, source=source_of(options),
    )  # fmt: skip
    paths = {"video": options.source, **inputs_of(options.extra or [])}
    order = RenderOrder(request, paths, where, artefacts, options.overwrite, sequence)
    return replace(order, passes_to=passes_target(options.passes_to, order.request.output))


def _sequence(options: RenderOptions) -> SequenceOptions:
    return sequence_of(options.missing, options.fps, options.layer, options.view, options.vectors)


_NO_PIPE = (
    "artefact", "as_json", "workers", "frames", "estimate", "explain", "sound_track", "colour_out", "passes",
    "passes_format", "passes_to", "output_format", "shot",
)  # fmt: skip
_OF_FILES = ("video_stream", "missing", "fps", "layer", "view", "vectors", "premultiplied", "colour_in", "colour_view")
_OF_FILMS = ("quality", "profile", "alpha", "overwrite")
_OF_SHOTS = (
    "method", "param", "extra", "seed", "quality", "profile", "alpha", "colour_out", "fields",
    *_OF_FILES, "sound_track",
)  # fmt: skip
"""Options that an exported project answers itself."""
