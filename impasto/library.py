"""`impasto.render`: a method from Python, in this process, without a service, a database or child processes.

A causal method (`abstraction`, `multistyle` without a design) returns one frame for each source frame, as in a live
session: frame i is returned before frame i + 1 of the source is read. Any other method runs its plan, which reads the
source several times; then a source that is an iterator is first written to a temporary file, uncompressed.
"""

from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, cast, overload

import numpy as np

from impasto.delivery import OutputTarget, deliver, expanded, output_faults, same_file, target
from pipeline.arrays import AnyArray
from pipeline.errors import BadInput, BadParameter, did_you_mean
from pipeline.formats.base import Encoding
from pipeline.frames import Frame, check_frame, same_size
from pipeline.methods import method as find_method
from pipeline.methods import parse_params
from pipeline.methods.base import AnyParams, Arrays, InputSpec, Method, VideoInfo, missing_inputs
from pipeline.methods.local import DEFAULT_FPS, FrameSource, Input, LocalContext, iterate_plan
from pipeline.video.depth import with_opacity
from pipeline.video.join import join
from pipeline.video.media import SEQUENCE_FPS, Opacity, SourceOptions
from pipeline.video.numbered import NumberedImages, by_frame
from pipeline.video.reader import VideoReader
from pipeline.video.sequence_options import SequenceOptions, options_of
from pipeline.video.writer import SegmentSpec, segment_writer
from workers.contract.request import Alpha, OutputSpec
from workers.execution.arrays import read_arrays, write_arrays
from workers.execution.input_damage import InputDamage
from workers.scheduling.outputs import check_output


@dataclass(frozen=True)
class SourceFile:
    """A video file, and how it is read."""

    path: str | Path
    options: SourceOptions = field(default_factory=SourceOptions)


@dataclass(frozen=True)
class ImageSequence:
    """Numbered images as a source or input.

    Attributes:
        path: a folder, a zip, one image, or a pattern: "shot/name.####.png", "name.%04d.png", "name.[1-20].png".
        fps: frames per second.
        missing: numbers that are missing: "fail", "hold" (repeat the frame before) or "skip".
        layer, view: which picture of images with several layers or views; "": the usual one.
    """

    path: str | Path
    fps: float | str = SEQUENCE_FPS
    missing: str = "fail"
    layer: str = ""
    view: str = ""
    source: SourceOptions = field(default_factory=SourceOptions)
    """Whether the colours of pictures with opacity are premultiplied; the rest is for videos."""

    def options(self) -> SequenceOptions:
        """Raises BadParameter."""
        values = {"fps": self.fps, "missing": self.missing, "layer": self.layer, "view": self.view}
        return options_of(values, "source")


@dataclass(frozen=True)
class OutputFile:
    """An output, and how it is encoded.

    Attributes:
        path: see `render`.
        profile: encoding of the format, for example "4444" of .mov: see `impasto formats`; "": its usual one.
        alpha: opacity of the output: "source", "none" (the source over white), or "auto": that of the source if the
            profile has opacity.
    """

    path: str | Path
    profile: str = ""
    alpha: Alpha = "auto"


Source = str | Path | SourceFile | ImageSequence | Iterable[Frame]
PICTURES = frozenset({"video", "image", "image-or-video"})


class DamagedSource(UserWarning):
    """Frames of a file are missing or unreadable."""


class NoEffect(UserWarning):
    """A parameter or an input was given that has no effect."""


class MethodNotice(UserWarning):
    """The method tells something about the inputs and the result."""


class SourceNotice(UserWarning):
    """Something of a file was chosen, corrected, assumed or left out, on reading it or on writing the output."""


@overload
def render(
    method: str, source: Source, output: None = None, *, inputs: Mapping[str, object] | None = None,
    seed: int = 0, fps: float = DEFAULT_FPS, **params: Any,
) -> Iterator[Frame]: ...  # fmt: skip


@overload
def render(
    method: str, source: Source, output: str | Path | OutputFile, *, inputs: Mapping[str, object] | None = None,
    seed: int = 0, fps: float = DEFAULT_FPS, quality: int = 20, overwrite: bool = False,
    **params: Any,
) -> Path: ...  # fmt: skip


def render(
    method: str, source: Source, output: str | Path | OutputFile | None = None, *,
    inputs: Mapping[str, object] | None = None, seed: int = 0, fps: float = DEFAULT_FPS, quality: int = 20,
    overwrite: bool = False, **params: Any,
) -> Iterator[Frame] | Path:  # fmt: skip
    """Stylise a video.

    Args:
        method: a method's name: "abstraction", "multistyle", "patches", "analogy", or one of an installed package.
        source: path of a video, image, or folder, zip or pattern of numbered images; a `SourceFile`, which also says
            which streams of a video are read, and how; an `ImageSequence`, which also has a frame rate and a treatment
            of missing numbers; or an iterable of frames, arrays uint8 (height, width, 3), RGB, all of one size, at
            least 16 px on each side. Frames are read lazily.
        output: None, or a path with the extension of an output format (`pipeline.formats`: .mp4, .webm, .zip of PNG
            frames, .png for one frame, ...), a folder "name/", or a folder with names "folder/name.####.tif"; an
            `OutputFile` also chooses codec, depth and opacity.
        inputs: further inputs by name: a path, or for pictures an array or an iterable of arrays, for a JSON document
            the parsed document, for numbered images a mapping from frame number to array.
        seed: seed of all random choices.
        fps: frames per second of a source that is an iterable.
        quality: rate factor of a video file, 0 (lossless) to 51.
        overwrite: whether an existing output may be replaced. An input is never overwritten.
        params: parameters of the method, as `impasto methods NAME` lists them.

    Returns:
        Without `output`, an iterator of frames, uint8 (height, width, 3); else the path of the finished file.

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
        pipeline.errors.BadParameter: Unknown parameter 'line'. ... Did you mean 'lines'? ...
    """
    chosen = find_method(method)
    parsed = parse_params(chosen, params)
    _check_names(chosen, inputs or {})
    for found in chosen.ineffective(parsed, {"video", *(inputs or {})}, stream=False, piece=False):
        warnings.warn(found.message, NoEffect, stacklevel=2)
    file = output if isinstance(output, OutputFile) else OutputFile("" if output is None else output)
    where = None if output is None else _checked_output(file.path, source, inputs or {}, overwrite)
    stack = ExitStack()
    if where is not None:
        spec = OutputSpec(where.format, quality, profile=file.profile, alpha=file.alpha)
        check_output(chosen, spec)
        source = _reading(source, "straight") if spec.keeps_opacity else source
    damage = InputDamage(fails=False)
    stack.callback(_warn, damage)
    frames = _Rendering(chosen, parsed, seed, fps, stack, damage).frames(source, inputs or {})
    if where is None:
        return frames
    with stack:
        _write(frames, source, SegmentSpec(where.format, (0, 0), Fraction(1), fps, quality, file.profile), where)
    return where.path


def _check_names(chosen: Method, inputs: Mapping[str, object]) -> None:
    known = [spec.name for spec in chosen.inputs if spec.name != "video"]
    for name in inputs:
        if name not in known:
            raise BadParameter(
                f"The method {chosen.name!r} has no input {name!r}.",
                field=f"inputs.{name}",
                remedy=did_you_mean(name, known, "inputs"),
            )
    for spec, why in missing_inputs(chosen.inputs, {"video", *inputs}):
        remedy = f"Give inputs={{{spec.name!r}: ...}}. {spec.help}"
        raise BadParameter(why, field=f"inputs.{spec.name}", remedy=remedy)


def _checked_output(output: str | Path, source: Source, inputs: Mapping[str, object], overwrite: bool) -> OutputTarget:
    where = target(str(output), field="output")
    for given in (source, *inputs.values()):
        if (file := _file(given)) is not None and same_file(where.path, Path(file.path)):
            raise BadInput("The output is an input.", field="output", value=output, remedy="Name another file.")
    if where.path.exists() and not overwrite and not (where.path.is_dir() and not any(where.path.iterdir())):
        raise BadInput(
            "The output exists already.", field="output", value=output, remedy="Pass overwrite=True, or name another."
        )
    return where


class _Rendering:
    """One call of `render`. `stack` closes what the frames are made from."""

    def __init__(
        self, chosen: Method, params: AnyParams, seed: int, fps: float, stack: ExitStack, damage: InputDamage
    ) -> None:
        self._method, self._params, self._seed, self._fps, self._stack = chosen, params, seed, fps, stack
        self._damage = damage
        self._specs = {spec.name: spec for spec in chosen.inputs}

    def frames(self, source: Source, inputs: Mapping[str, object]) -> Iterator[Frame]:
        """The finished frames. Closing the iterator, or its end, frees everything."""
        with self._stack:
            if self._streams(inputs):
                arriving = _checked(self._open_frames("video", source))
                first = next(arriving, None)
                if first is None:
                    return
                streamed = self._stream(first, arriving, inputs)
                if streamed is not None:
                    yield from streamed
                    return
                if _file(source) is None:
                    source = chain([first], arriving)
            yield from self._planned(source, inputs)

    def _streams(self, inputs: Mapping[str, object]) -> bool:
        """Whether a session has everything that is given: otherwise the plan runs."""
        lost, whole = (
            {found.field for found in self._method.ineffective(self._params, {"video", *inputs}, stream, False)}
            for stream in (True, False)
        )
        return lost <= whole and all(self._specs[name].kind in PICTURES for name in inputs)

    def _stream(self, first: Frame, rest: Iterator[Frame], inputs: Mapping[str, object]) -> Iterator[Frame] | None:
        size = (first.shape[1], first.shape[0])
        references = {name: _checked(self._open_frames(name, _many(given))) for name, given in inputs.items()}
        session = self._method.stream(self._params, size, self._seed, references)
        if session is None:
            return None
        return (session.step(frame) for frame in chain([first], rest))

    def _open_frames(self, name: str, source: Source) -> Iterator[Frame]:
        """The frames of the input `name`."""
        file = _file(source)
        if file is None:
            return iter(cast("Iterable[Frame]", source))
        return _read(self._stack.enter_context(opened(file)), name, self._damage)

    def _planned(self, source: Source, inputs: Mapping[str, object]) -> Iterator[Frame]:
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="impasto-")))
        given: dict[str, Any] = {}
        video = self._source("video", source, folder)
        numbers = video.numbers if isinstance(video, FileFrames) else ()
        for name, value in inputs.items():
            given |= self._input(self._specs[name], value, folder, numbers)
        context = _DiskContext(self._params, video, given, self._seed, folder=folder)
        following = 0
        for _ in iterate_plan(self._method, context):
            while following in context.emitted:
                yield context.emitted.pop(following)
                following += 1
        for message in context.warnings:
            warnings.warn(message, MethodNotice, stacklevel=2)

    def _source(self, name: str, source: Source, folder: Path) -> FrameSource:
        if (file := _file(source)) is not None:
            return FileFrames(file, self._stack, name, self._damage)
        number = sum(1 for _ in folder.iterdir())
        return SpooledFrames(_checked(iter(cast("Iterable[Frame]", source))), self._fps, folder / f"frames-{number}")

    def _input(self, spec: InputSpec, value: Any, folder: Path, numbers: tuple[int, ...]) -> dict[str, Any]:
        """An input in the form that `LocalContext` accepts."""
        is_path = isinstance(value, str | Path)
        if spec.kind in PICTURES:
            return {spec.name: self._source(spec.name, _many(value), folder)}
        if spec.kind == "json":
            return {spec.name: json.loads(Path(value).read_text("utf-8-sig")) if is_path else value}
        field = f"inputs.{spec.name}"
        if not is_path:
            return {spec.name: by_frame(value, numbers, field)}
        images = NumberedImages(Path(value), field)
        self._stack.callback(images.close)
        return {spec.name: by_frame(images, numbers, field)}


def _file(given: object) -> SourceFile | ImageSequence | None:
    """A source that is a path, with its options; None: it is something else."""
    if isinstance(given, str | Path):
        return SourceFile(given)
    return given if isinstance(given, SourceFile | ImageSequence) else None


def _reading(source: Source, opacity: Opacity) -> Source:
    """The source, read so that frames show this of its pictures."""
    file = _file(source)
    if isinstance(file, SourceFile):
        return replace(file, options=replace(file.options, opacity=opacity))
    return source if file is None else replace(file, source=replace(file.source, opacity=opacity))


def opened(file: SourceFile | ImageSequence) -> VideoReader:
    """A reader of the file. Close it. Raises: as `VideoReader`."""
    path = expanded(Path(file.path))
    if isinstance(file, SourceFile):
        return VideoReader(path, options=file.options)
    return VideoReader(path, options=file.source, sequence=file.options())


def _many(value: Any) -> Source:
    """An input's pictures: one array is a video of one frame."""
    return [value] if isinstance(value, np.ndarray) and value.ndim == 3 else value


def _read(
    reader: VideoReader, name: str, damage: InputDamage, start: int = 0, stop: int | None = None
) -> Iterator[Frame]:
    """Frames [start, stop) of the input `name`; what is wrong with them is recorded. Raises DamagedMedia."""
    damage.note(name, reader.notes)
    damage.record(name, reader.index, ())
    known = len(reader.unreadable)
    for frame in reader.read(start, stop):
        if len(reader.unreadable) > known:
            damage.record(name, reader.index, reader.unreadable[known:])
            known = len(reader.unreadable)
        yield frame


def _warn(damage: InputDamage) -> None:
    for warning in damage.warnings():
        kind = DamagedSource if warning.damage else SourceNotice
        warnings.warn(warning.message, kind, stacklevel=2)


def _checked(frames: Iterator[Frame]) -> Iterator[Frame]:
    """Yield the frames; raises BadFrame unless each has the size of the first one."""
    size: tuple[int, int] | None = None
    for index, array in enumerate(frames):
        frame = check_frame(array, f"source[{index}]")
        size = size or (frame.shape[1], frame.shape[0])
        yield same_size(frame, size, f"source[{index}]")


class FileFrames:
    """A video file as a `FrameSource`. Iterators that are open at once have decoders of their own."""

    def __init__(self, file: SourceFile | ImageSequence, stack: ExitStack, name: str, damage: InputDamage) -> None:
        self._file, self._stack, self._name, self._damage = file, stack, name, damage
        self._idle = [self._open()]
        reader = self._idle[0]
        self.numbers = reader.index.numbers
        """Numbers of the frames of an image sequence; empty: they are counted from 0."""
        width, height = reader.size
        self.info = VideoInfo(width, height, reader.frames, reader.fps, reader.index.duration_s)

    def _open(self) -> VideoReader:
        return self._stack.enter_context(opened(self._file))

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        reader = self._idle.pop() if self._idle else self._open()
        try:
            yield from _read(reader, self._name, self._damage, start, stop)
        finally:
            self._idle.append(reader)


class SpooledFrames:
    """Frames of an iterator as a `FrameSource`: written once to the file `path`, uncompressed, then read in any
    order."""

    def __init__(self, frames: Iterator[Frame], fps: float, path: Path) -> None:
        count, height, width = 0, 0, 0
        with path.open("wb") as file:
            for frame in frames:
                height, width = frame.shape[:2]
                file.write(frame.tobytes())
                count += 1
        if count == 0:
            raise BadInput("The source has no frames.", field="source", remedy="Give at least one.")
        self._frames = np.memmap(path, np.uint8, "r", shape=(count, height, width, 3))
        self.info = VideoInfo(width, height, count, fps, count / fps)

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        for index in range(start, self.info.frames if stop is None else min(stop, self.info.frames)):
            yield np.array(self._frames[index])


class _DiskContext(LocalContext[AnyParams]):
    """A context whose artefacts lie in a folder, so that memory does not grow with the length of the video."""

    def __init__(
        self, params: AnyParams, video: FrameSource, inputs: Mapping[str, Input], seed: int, *, folder: Path
    ) -> None:
        super().__init__(params, video, inputs, seed)
        self._folder = folder

    def save(self, name: str, arrays: Arrays) -> None:
        super().save(name, {})
        with self._path(self.step, name).open("wb") as file:
            write_arrays(file, arrays)

    def load(self, step: str, name: str) -> dict[str, AnyArray]:
        super().load(step, name)  # whether the task may
        with self._path(step, name).open("rb") as file:
            return read_arrays(file.read())

    def _path(self, step: str, name: str) -> Path:
        return self._folder / f"{step}--{name.replace('/', '--')}"


def _matte(source: Source, stack: ExitStack) -> Iterator[Frame] | None:
    """The opacity of the source's frames, gray, if the output gets it."""
    file = _file(source)
    options = file.options if isinstance(file, SourceFile) else None if file is None else file.source
    if options is None or options.opacity != "straight":
        return None
    return stack.enter_context(opened(cast("SourceFile", _reading(source, "matte")))).read()


def _write(frames: Iterator[Frame], source: Source, wanted: SegmentSpec, where: OutputTarget) -> None:
    """Encode the frames at the times of the source, add its sound, and put the file in its place.

    Args:
        wanted: format, profile and quality, and the frame rate of a source without one.
    """
    with tempfile.TemporaryDirectory(prefix="impasto-") as folder, ExitStack() as stack:
        segment, whole = Path(folder) / "segment", Path(folder) / "whole"
        file = _file(source)
        sound = None if file is None else expanded(Path(file.path))
        reader = None if file is None else stack.enter_context(opened(file))
        times = None if reader is None else reader.index
        rate = Fraction(wanted.fps).limit_denominator(1001)
        first = next(frames, None)
        if first is None:
            raise BadInput("The source has no frames.", field="source", remedy="Give at least one.")
        size = (first.shape[1], first.shape[0])
        base, nominal = (1 / rate, wanted.fps) if times is None else (times.time_base, times.fps)
        matte = _matte(source, stack) if reader is not None and reader.has_alpha else None
        spec = replace(wanted, size=size, time_base=base, fps=nominal, alpha=matte is not None)
        with segment_writer(segment, spec) as writer:
            for index, frame in enumerate(chain([first], frames)):
                start, stop = (index, index + 1) if times is None else (times.time(index), times.time(index + 1))
                shown = frame if matte is None else with_opacity(frame, next(matte)[..., 0])
                writer.write(index if times is None else times.number(index), shown, start, stop)
        origin = Fraction(0) if times is None else times.time(0) * base
        options = file.options if isinstance(file, SourceFile) else None
        for note in join([(origin, segment)], whole, Encoding(spec.format, spec.quality), sound, options=options):
            warnings.warn(note.message, SourceNotice, stacklevel=4)
        with output_faults("output", where.path):
            deliver(whole, where)
