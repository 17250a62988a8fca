"""`impasto.render`: a method from Python, in this process, without a service, a database or child processes.

A causal method (`abstraction`, `multistyle` without a design) returns one frame for each source frame, as in a live
session: frame i is returned before frame i + 1 of the source is read. Any other method runs its plan, which reads the
source several times; then a source that is an iterator is first written to a temporary file, uncompressed.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, cast, overload

from impasto.delivery import OutputTarget, beside, deliver, expanded, output_faults, same_file, target
from impasto.rendering import NoEffect, Rendering, Tell
from impasto.sources import (
    ImageSequence,
    Source,
    SourceFile,
    SourceNotice,
    file_of,
    opened,
    options_of_source,
    showing,
    warn_of_damage,
)
from pipeline.arrays import AnyArray
from pipeline.errors import BadInput, BadParameter, did_you_mean
from pipeline.formats import IN_FILM, OUTPUTS
from pipeline.formats.base import Encoding
from pipeline.frames import Frame
from pipeline.methods import method as find_method
from pipeline.methods import parse_params
from pipeline.methods.base import Method, missing_inputs
from pipeline.methods.local import DEFAULT_FPS
from pipeline.passes.made import PASSES
from pipeline.video.depth import with_opacity
from pipeline.video.join import join
from pipeline.video.numbering import is_pattern
from pipeline.video.writer import SegmentSpec, segment_writer
from workers.contract.request import MAX_SEED, Alpha, OutputSpec
from workers.execution.input_damage import InputDamage
from workers.execution.pass_files import add_to_film
from workers.scheduling.outputs import check_output


@dataclass(frozen=True)
class OutputFile:
    """An output, and how it is encoded.

    Attributes:
        path: see `render`.
        profile: encoding of the format, for example "4444" of .mov: see `impasto formats`; "": its usual one.
        alpha: opacity of the output: "source", "painted" (that of the paint), "none" (the source over white), or
            "auto": that of the source if the profile has opacity.
        colour: colour space of the output, a name of the OpenColorIO configuration, for images of more than 8 bits;
            "PQ" or "HLG" for video of more than 8 bits; "": that of the profile.
        passes: names of passes of the method, such as "flow" (`impasto methods NAME` lists them): they are saved beside
            the output, "painted-passes.zip" beside "painted.mp4".
        passes_format: their format, one of `pipeline.formats.PASS_FORMATS`; "": the first one, an image a frame with a
            layer for each pass; "film": layers in the images of the output itself, if they can hold any.
    """

    path: str | Path
    profile: str = ""
    alpha: Alpha = "auto"
    colour: str = ""
    passes: tuple[str, ...] = ()
    passes_format: str = ""


@overload
def render(
    method: str, source: Source, output: None = None, *, inputs: Mapping[str, object] | None = None,
    seed: int = 0, fps: float = DEFAULT_FPS, progress: Tell | None = None, **params: Any,
) -> Iterator[AnyArray]: ...  # fmt: skip


@overload
def render(
    method: str, source: Source, output: str | Path | OutputFile, *, inputs: Mapping[str, object] | None = None,
    seed: int = 0, fps: float = DEFAULT_FPS, quality: int = 20, overwrite: bool = False,
    progress: Tell | None = None, **params: Any,
) -> Path: ...  # fmt: skip


def render(  # noqa: PLR0913 (all but three by name)
    method: str, source: Source, output: str | Path | OutputFile | None = None, *,
    inputs: Mapping[str, object] | None = None, seed: int = 0, fps: float = DEFAULT_FPS, quality: int = 20,
    overwrite: bool = False, progress: Tell | None = None, **params: Any,
) -> Iterator[AnyArray] | Path:  # fmt: skip
    """Stylise a video.

    Args:
        method: a method's name: "abstraction", "multistyle", "patches", "analogy", or one of an installed package.
        source: path of a video, image, or folder, zip or pattern of numbered images; a `SourceFile`, which also says
            which streams of a video are read, and how; an `ImageSequence`, which also has a frame rate and a treatment
            of missing numbers; or an iterable of frames: RGB arrays (height, width, 3), or 4 channels with straight
            opacity; uint8, uint16, or floats with white at 1; all alike, at least 16 px on each side. Frames are read
            lazily.
        output: None, or a path with the extension of an output format (`pipeline.formats`: .mp4, .webm, .zip of PNG
            frames, .png for one frame, ...), a folder "name/", or a folder with names "folder/name.####.tif"; an
            `OutputFile` also chooses codec, depth and opacity.
        inputs: further inputs by name: a path, or for pictures an array or an iterable of arrays, for a JSON document
            the parsed document, for numbered images a mapping from frame number to array.
        seed: seed of all random choices.
        fps: frames per second of a source that is an iterable.
        quality: rate factor of a video file, 0 (lossless) to 51.
        overwrite: whether an existing output may be replaced. An input is never overwritten.
        progress: called with the share of the work that is done, 0 to 1, after each frame or part of a task; not for
            frames that come from an iterator without a length and leave one by one. An exception that it raises ends
            the render, and no output is left.
        params: parameters of the method, as `impasto methods NAME` lists them.

    Returns:
        Without `output`, an iterator of frames, uint8 (height, width, 3), or for arrays in their type and with their
        opacity (a method without deep colours computes 8 bits); else the path of the finished file.

    Raises:
        BadParameter: an unknown method or input, or a parameter that is out of range.
        BadInput: a source or output that cannot be used (BadMedia, BadFrame).

    Warns:
        DamagedSource: frames of a file are missing or unreadable; the others were used. Issued after the last frame;
            `warnings.simplefilter("error", DamagedSource)` makes it an error.
        SourceNotice: something of the file was chosen, corrected, assumed or left out of the output.
        MethodNotice: the method tells something, such as a shot without a painted key.
        NoEffect: a parameter or an input was given that has no effect with the others.

    Examples:
        Frames in, frames out, one at a time:

        >>> import numpy as np
        >>> import impasto
        >>> gray = [np.full((48, 64, 3), value, np.uint8) for value in (90, 120, 150)]
        >>> frames = impasto.render("abstraction", gray, lines="off")
        >>> next(frames).shape
        (48, 64, 3)

        A file, with the sound of the source:

        >>> path = impasto.render("abstraction", gray, "gray.mp4", lines="off", fps=12)
        >>> path.name
        'gray.mp4'

        Mistakes are explained:

        >>> impasto.render("abstraction", gray, line="off")
        Traceback (most recent call last):
        ...
        impasto_client.errors.BadParameter: Unknown parameter 'line'. ... Did you mean 'lines'? ...
    """
    chosen = find_method(method)
    parsed = parse_params(chosen, params)
    if not 0 <= seed <= MAX_SEED:
        raise BadParameter("Not accepted.", field="seed", value=seed, remedy=f"Use 0 to {MAX_SEED}.")
    if (given := file_of(source)) is not None:
        _check_exists(given, "source")
    _check_names(chosen, inputs or {})
    file = output if isinstance(output, OutputFile) else OutputFile("" if output is None else output)
    for found in chosen.ineffective(parsed, {"video", *(inputs or {})}, False, False, passes=file.passes):
        warnings.warn(found.message, NoEffect, stacklevel=2)
    where = None if output is None else _checked_output(file.path, source, inputs or {}, overwrite)
    for name in _unused(source, where, fps, quality, overwrite, file.profile):
        warnings.warn(f"{name} has no effect here.", NoEffect, stacklevel=2)
    stack = ExitStack()
    if where is not None:
        spec = OutputSpec(
            where.format, quality, profile=file.profile, alpha=file.alpha, colour=file.colour, passes=file.passes,
            passes_format=file.passes_format,
        )  # fmt: skip
        check_output(chosen, spec)
        source = showing(source, "straight") if spec.reads_colours else source
    damage = InputDamage(fails=False)
    stack.callback(warn_of_damage, damage)
    rendering = Rendering(chosen, parsed, seed, fps, stack, damage, progress)
    if where is None:
        return rendering.frames(source, inputs or {})
    rendering.returns = False
    rendering.opacity = "straight" if spec.reads_colours else "white"
    rendering.deep = spec.encoding.is_deep and chosen.depth_bits > 8
    rendering.paints_opacity = spec.alpha == "painted"
    wanted = SegmentSpec(
        where.format, (0, 0), Fraction(1), fps, quality, file.profile, rendering.paints_opacity, file.colour,
        options_of_source(source).colour_view,
    )  # fmt: skip
    with stack, tempfile.TemporaryDirectory(prefix="impasto-") as folder:
        rendering.output, rendering.passes_file = spec, Path(folder) / PASSES
        passes_to = beside(where, f"{PASSES}.zip")
        in_film = spec.passes_format == IN_FILM
        if spec.passes and not in_film and passes_to.exists() and not overwrite:
            raise BadInput("The passes exist already.", field="output", value=passes_to,
                           remedy="Pass overwrite=True, or name another output.")  # fmt: skip
        frames = rendering.frames(source, inputs or {})
        _write(frames, source, wanted, where, rendering.passes_file if in_film else None)
        if rendering.passes_file.exists() and not in_film:
            deliver(rendering.passes_file, OutputTarget(passes_to, "", "file"))
    return where.path


def _unused(
    source: Source, where: OutputTarget | None, fps: float, quality: int, overwrite: bool, profile: str
) -> Iterator[str]:
    """Arguments of `render` that are given and not used."""
    if fps != DEFAULT_FPS and file_of(source) is not None:
        yield "fps"
    if where is None and overwrite:
        yield "overwrite"
    has_quality = where is not None and OUTPUTS[where.format].profile(profile).has_quality
    if quality != OutputSpec().quality and not has_quality:
        yield "quality"


def _check_names(chosen: Method, inputs: Mapping[str, object]) -> None:
    known = [spec.name for spec in chosen.inputs if spec.name != "video"]
    for name in inputs:
        if name not in known:
            raise BadParameter(
                f"The method {chosen.name!r} has no input {name!r}.",
                field=f"inputs.{name}",
                remedy=did_you_mean(name, known, "inputs"),
            )
        if (file := file_of(inputs[name])) is not None:
            _check_exists(file, f"inputs.{name}")
    for spec, why in missing_inputs(chosen.inputs, {"video", *inputs}):
        remedy = f"Give inputs={{{spec.name!r}: ...}}. {spec.help}"
        raise BadParameter(why, field=f"inputs.{spec.name}", remedy=remedy)


def _check_exists(file: SourceFile | ImageSequence, field: str) -> None:
    path = expanded(Path(file.path))
    if not path.exists() and not is_pattern(path.name):
        raise BadInput("File or folder not found.", field=field, value=path, remedy="Check the path.")


def _checked_output(output: str | Path, source: Source, inputs: Mapping[str, object], overwrite: bool) -> OutputTarget:
    where = target(str(output), field="output")
    for given in (source, *inputs.values()):
        if (file := file_of(given)) is not None and same_file(where.path, Path(file.path)):
            raise BadInput("The output is an input.", field="output", value=output, remedy="Name another file.")
    if where.path.exists() and not overwrite and not (where.path.is_dir() and not any(where.path.iterdir())):
        raise BadInput(
            "The output exists already.", field="output", value=output, remedy="Pass overwrite=True, or name another."
        )
    return where


def _matte(source: Source, stack: ExitStack) -> Iterator[Frame] | None:
    """The opacity of the source's frames, gray, if the output gets it."""
    if options_of_source(source).opacity != "straight":
        return None
    return stack.enter_context(opened(cast("SourceFile", showing(source, "matte")))).read()


def _write(
    frames: Iterator[AnyArray], source: Source, wanted: SegmentSpec, where: OutputTarget, passes: Path | None
) -> None:  # fmt: skip
    """Encode the frames at the times of the source, add its sound, and put the file in its place.

    Args:
        wanted: format, profile, quality and colour space, the frame rate of a source without one, and whether the
            frames have opacity themselves.
        passes: a file that exists when all frames are painted, whose layers are added to their images; None: no file.
    """
    with tempfile.TemporaryDirectory(prefix="impasto-") as folder, ExitStack() as stack:
        segment, whole = Path(folder) / "segment", Path(folder) / "whole"
        file = file_of(source)
        sound = None if file is None else expanded(Path(file.path))
        reader = None if file is None else stack.enter_context(opened(file))
        times = None if reader is None else reader.index
        rate = Fraction(wanted.fps).limit_denominator(1001)
        first = next(frames, None)
        if first is None:
            raise BadInput("The source has no frames.", field="source", remedy="Give at least one.")
        size = (first.shape[1], first.shape[0])
        base, nominal = (1 / rate, wanted.fps) if times is None else (times.time_base, times.fps)
        matte = _matte(source, stack) if reader is not None and reader.has_alpha and not wanted.alpha else None
        alpha = wanted.alpha or matte is not None or first.shape[2] == 4
        spec = replace(wanted, size=size, time_base=base, fps=nominal, alpha=alpha)
        with segment_writer(segment, spec) as writer:
            for index, frame in enumerate(chain([first], frames)):
                start, stop = (index, index + 1) if times is None else (times.time(index), times.time(index + 1))
                shown = frame if matte is None else with_opacity(frame, next(matte)[..., 0])
                writer.write(index if times is None else times.number(index), shown, start, stop)
        origin = Fraction(0) if times is None else times.time(0) * base
        options = file.options if isinstance(file, SourceFile) else None
        for note in join([(origin, segment)], whole, Encoding(spec.format, spec.quality), sound, options=options):
            warnings.warn(note.message, SourceNotice, stacklevel=4)
        if passes is not None and passes.exists():
            add_to_film(whole, passes, Path(folder) / "with-passes")
            whole = Path(folder) / "with-passes"
        with output_faults("output", where.path):
            deliver(whole, where)
