"""Inputs of `impasto.render`, read frame by frame: files, image sequences and arrays; and the warnings about them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from impasto.delivery import expanded
from pipeline.arrays import AnyArray
from pipeline.frames import Frame
from pipeline.methods.base import VideoInfo
from pipeline.video.media import SEQUENCE_FPS, Opacity, SourceOptions
from pipeline.video.reader import VideoReader
from pipeline.video.sequence_options import USUAL, SequenceOptions, options_of
from workers.execution.input_damage import InputDamage


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
        vectors: convention of motion vectors: "auto" (found by warping), "off" (not used), "blender", "nuke".
    """

    path: str | Path
    fps: float | str = SEQUENCE_FPS
    missing: str = "fail"
    layer: str = ""
    view: str = ""
    vectors: str = "auto"
    source: SourceOptions = field(default_factory=SourceOptions)
    """Colours, and whether those of pictures with opacity are premultiplied; the rest is for videos."""

    def options(self) -> SequenceOptions:
        """Raises BadParameter."""
        values = {name: getattr(self, name) for name in ("fps", "missing", "layer", "view", "vectors")}
        return options_of(values, "source")


Source = str | Path | SourceFile | ImageSequence | Iterable[AnyArray]


class DamagedSource(UserWarning):
    """Frames of a file are missing or unreadable."""


class SourceNotice(UserWarning):
    """Something of a file was chosen, corrected, assumed or left out, on reading it or on writing the output."""


def sequence_options_of(file: SourceFile | ImageSequence) -> SequenceOptions:
    return file.options() if isinstance(file, ImageSequence) else USUAL


def file_of(given: object) -> SourceFile | ImageSequence | None:
    """A source that is a path, with its options; None: it is something else."""
    if isinstance(given, str | Path):
        return SourceFile(given)
    return given if isinstance(given, SourceFile | ImageSequence) else None


def options_of_source(source: Source) -> SourceOptions:
    """How the source is read."""
    file = file_of(source)
    return SourceOptions() if file is None else file.options if isinstance(file, SourceFile) else file.source


def showing(source: Source, opacity: Opacity) -> Source:
    """The source, read so that frames show this of its pictures."""
    file = file_of(source)
    if isinstance(file, SourceFile):
        return replace(file, options=replace(file.options, opacity=opacity))
    return source if file is None else replace(file, source=replace(file.source, opacity=opacity))


def opened(file: SourceFile | ImageSequence) -> VideoReader:
    """A reader of the file. Close it. Raises: as `VideoReader`."""
    path = expanded(Path(file.path))
    if isinstance(file, SourceFile):
        return VideoReader(path, options=file.options)
    return VideoReader(path, options=file.source, sequence=file.options())


def read_noting(
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


def warn_of_damage(damage: InputDamage) -> None:
    for warning in damage.warnings():
        kind = DamagedSource if warning.damage else SourceNotice
        warnings.warn(warning.message, kind, stacklevel=2)


class FileFrames:
    """A video file as a `FrameSource`. Iterators that are open at once have decoders of their own."""

    def __init__(self, file: SourceFile | ImageSequence, stack: ExitStack, name: str, damage: InputDamage) -> None:
        self._file, self._stack, self._name, self._damage = file, stack, name, damage
        self._idle = [self._open()]
        reader = self._idle[0]
        self.has_alpha = reader.has_alpha
        self.numbers = reader.index.numbers
        """Numbers of the frames of an image sequence; empty: they are counted from 0."""
        width, height = reader.size
        self.info = VideoInfo(width, height, reader.frames, reader.fps, reader.index.duration_s)

    def _open(self) -> VideoReader:
        return self._stack.enter_context(opened(self._file))

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        reader = self._idle.pop() if self._idle else self._open()
        try:
            yield from read_noting(reader, self._name, self._damage, start, stop)
        finally:
            self._idle.append(reader)

    def read_deep(self, start: int, stop: int | None) -> Iterator[AnyArray]:
        """Like `read`, uint16 or float32 if the file has more than 8 bits."""
        file = self._file
        if isinstance(file, SourceFile):
            file = replace(file, options=replace(file.options, deep=True))
        else:
            file = replace(file, source=replace(file.source, deep=True))
        with opened(file) as reader:
            yield from read_noting(reader, self._name, self._damage, start, stop)
