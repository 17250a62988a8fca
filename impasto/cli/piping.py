"""`impasto render` on pipes: `-` as IN reads from stdin, `-` as OUT writes to stdout."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import chain
from pathlib import Path

from impasto.cli.console import print_warnings
from impasto.library import OutputFile, render
from impasto.sources import DamagedSource, ImageSequence, SourceFile, opened
from impasto.y4m import StreamFormat, Y4mReader, Y4mWriter, raw_frames, write_raw
from pipeline.errors import BadInput, BadParameter, DamagedMedia
from pipeline.frames import Frame
from pipeline.video.media import Limits, SourceOptions, check_size
from pipeline.video.sequence_options import USUAL, SequenceOptions
from workers.contract.request import FAIL, WARN, Alpha, Json

PIPE = "-"
DEFAULT_FPS = Fraction(25)
_RAW = re.compile(r"(\d{1,5})x(\d{1,5})(?:@(\d{1,4}(?:\.\d{1,3}|/\d{1,4})?))?")


@dataclass(frozen=True)
class PipeOrder:
    """A render with a pipe at one end or both.

    Attributes:
        source, output: a path, or "-".
        on_damage: "warn" or "fail", for files with frames that are missing or unreadable.
        options: how a video file, or interlaced YUV4MPEG2, is read.
        sequence: how a sequence of images is read.
        profile, alpha: encoding and opacity of an output file.
        raw: "WIDTHxHEIGHT[@FPS]" if pipes carry raw RGB, "" if YUV4MPEG2.
    """

    source: str
    output: str
    method: str
    params: Mapping[str, object]
    inputs: Mapping[str, Path]
    seed: int
    quality: int
    overwrite: bool
    raw: str = ""
    on_damage: str = WARN
    options: SourceOptions = field(default_factory=SourceOptions)
    sequence: SequenceOptions = USUAL
    profile: str = ""
    alpha: Alpha = "auto"

    def run(self) -> int:
        """Render; returns the number of frames written to stdout, 0 if the output is a file.

        Raises: DamagedMedia at the end if frames of a file are missing or unreadable and `on_damage` is "fail".
        """
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print_warnings([{"message": str(message)}])
            if self.on_damage == FAIL:
                warnings.simplefilter("error", DamagedSource)
            try:
                return self._render()
            except DamagedSource as damage:
                raise DamagedMedia(str(damage), field="IN", value=self.source) from None

    def _render(self) -> int:
        frames, form = self._source()
        common: Json = {"inputs": self.inputs, "seed": self.seed}
        common |= {"fps": float(form.fps)} if self.source == PIPE else {}
        common |= self.params
        if self.output != PIPE:
            file = OutputFile(self.output, self.profile, self.alpha)
            render(self.method, frames, file, quality=self.quality, overwrite=self.overwrite, **common)
            return 0
        return self._write(render(self.method, frames, **common), form)

    def _source(self) -> tuple[SourceFile | ImageSequence | Iterator[Frame], StreamFormat]:
        raw = _raw_format(self.raw) if self.raw else None
        if self.source != PIPE:
            file = self._file()
            form = _file_format(file)
            if raw is not None and (raw.size != form.size or ("@" in self.raw and raw.fps != form.fps)):
                raise BadParameter(
                    "The frames of IN are others.", field="--raw", value=self.raw,
                    remedy=f"Write --raw {form.size[0]}x{form.size[1]}.",
                )  # fmt: skip
            return file, form
        if raw is not None:
            return raw_frames(sys.stdin.buffer, raw.size), raw
        reader = Y4mReader(sys.stdin.buffer, fields=self.options.fields)
        return iter(reader), reader.format

    def _file(self) -> SourceFile | ImageSequence:
        given = self.sequence
        if not given.given:
            return SourceFile(self.source, self.options)
        return ImageSequence(
            self.source, given.fps, given.missing, given.layer, given.view, given.vectors, self.options
        )  # fmt: skip

    def _write(self, frames: Iterator[Frame], form: StreamFormat) -> int:
        """Write each frame as soon as it is finished."""
        first = next(frames, None)
        if first is None:
            raise BadInput("The input has no frames.", field="IN", value=self.source, remedy="Send at least one.")
        put = self._sink(StreamFormat((first.shape[1], first.shape[0]), form.fps, _chroma(form)))
        count = 0
        for frame in chain([first], frames):
            put(frame)
            count += 1
        return count

    def _sink(self, form: StreamFormat) -> Callable[[Frame], None]:
        if self.raw:
            return lambda frame: write_raw(sys.stdout.buffer, frame)
        return Y4mWriter(sys.stdout.buffer, form).write


def _chroma(form: StreamFormat) -> str:
    """The subsampling of the source, in 8 bit."""
    return next((name for name in ("yuv444p", "yuv422p") if form.pixel_format.startswith(name)), "yuv420p")


def _file_format(file: SourceFile | ImageSequence) -> StreamFormat:
    with opened(file) as reader:
        return StreamFormat(reader.size, Fraction(reader.fps).limit_denominator(1001))


def _raw_format(text: str) -> StreamFormat:
    found = _RAW.fullmatch(text)
    if found is None:
        raise BadParameter(
            "The size of raw frames cannot be read.", field="--raw", value=text, remedy="Write --raw 640x360@25."
        )
    size = (int(found[1]), int(found[2]))
    check_size(*size, Limits(), "A raw frame")
    fps = Fraction(found[3]) if found[3] else DEFAULT_FPS
    if fps <= 0:
        raise BadParameter("The frame rate is not positive.", field="--raw", value=text, remedy="For example @25.")
    return StreamFormat(size, fps)
