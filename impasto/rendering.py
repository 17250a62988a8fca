"""One call of `impasto.render`: frames in, frames out, by a session that streams or by a plan."""

from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from contextlib import ExitStack, nullcontext
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np

from impasto.disk_context import DiskContext
from impasto.pictures import SpooledFrames, checked, frame_of, returned, with_its_opacity
from impasto.progress import Progress
from impasto.sequence_passes import files_with_passes, unused_beside_passes
from impasto.sources import FileFrames, Source, file_of, opened, read_noting, sequence_options_of, showing
from pipeline.arrays import AnyArray
from pipeline.methods.base import AnyParams, InputSpec, Method
from pipeline.methods.local import iterate_plan
from pipeline.video.media import Opacity
from pipeline.video.numbered import NumberedImages, by_frame
from workers.contract.request import OutputSpec
from workers.execution.input_damage import InputDamage
from workers.execution.pass_files import Part, unite

Tell = Callable[[float], object]
"""Called with the share of a render that is done, 0 to 1."""
PICTURES = frozenset({"video", "image", "image-or-video"})


class NoEffect(UserWarning):
    """A parameter or an input was given that has no effect."""


class MethodNotice(UserWarning):
    """The method tells something about the inputs and the result."""


class Rendering:
    """One call of `render`. `stack` closes what the frames are made from."""

    def __init__(
        self, chosen: Method, params: AnyParams, seed: int, fps: float, stack: ExitStack, damage: InputDamage,
        tell: Tell | None,
    ) -> None:  # fmt: skip
        self._method, self._params, self._seed, self._fps, self._stack = chosen, params, seed, fps, stack
        self._damage, self._tell = damage, tell
        self.returns = True
        self.opacity: Opacity = "straight"
        """Whether the caller gets the frames; what they show of arrays with opacity."""
        self.deep = self.paints_opacity = False
        """Whether frames may have more than 8 bits; whether they have the opacity of what was painted."""
        self.output, self.passes_file = OutputSpec(), Path()
        """The passes that are wanted, and the file that they are written to after the last frame."""
        self._specs = {spec.name: spec for spec in chosen.inputs}
        self._frames = 0
        """Frames of the source, if it is a file."""

    def frames(self, source: Source, inputs: Mapping[str, object]) -> Iterator[AnyArray]:
        """The finished frames. Closing the iterator, or its end, frees everything."""
        with self._stack:
            file = file_of(source)
            uses_passes = file is not None and self._method.passes
            files = files_with_passes(file.path, sequence_options_of(file), self._stack) if file and uses_passes else {}
            if files:
                for lost in unused_beside_passes(self._method, self._params, {"video", *inputs}, files):
                    warnings.warn(lost.message, NoEffect, 2)
                yield from self._planned(source, inputs, files)
                return
            if not (self.deep or self.paints_opacity or self.output.passes) and self._streams(inputs):
                arriving = checked(self._open_frames("video", source))
                first = next(arriving, None)
                if first is None:
                    return
                streamed = self._stream(first, arriving, inputs)
                if streamed is not None:
                    yield from self._told(streamed, source)
                    return
                if file_of(source) is None:
                    source = chain([first], arriving)
            yield from self._planned(source, inputs)

    def _told(self, frames: Iterator[AnyArray], source: Source) -> Iterator[AnyArray]:
        """The same frames. After each one, `progress` is called, if the number of frames is known."""
        if self._tell is None or not self._length(source):
            yield from frames
            return
        for index, frame in enumerate(frames, 1):
            self._tell(min(1.0, index / self._length(source)))
            yield frame

    def _length(self, source: Source) -> int:
        """Number of frames; 0: not known."""
        return len(source) if isinstance(source, Sized) and file_of(source) is None else self._frames

    def _streams(self, inputs: Mapping[str, object]) -> bool:
        """Whether a session has everything that is given: otherwise the plan runs."""
        lost, whole = (
            {found.field for found in self._method.ineffective(self._params, {"video", *inputs}, stream, False)}
            for stream in (True, False)
        )
        return lost <= whole and all(self._specs[name].kind in PICTURES for name in inputs)

    def _stream(
        self, first: AnyArray, rest: Iterator[AnyArray], inputs: Mapping[str, object]
    ) -> Iterator[AnyArray] | None:
        size = (first.shape[1], first.shape[0])
        references = {
            name: (frame_of(picture, "white") for picture in checked(self._open_frames(name, _many(given))))
            for name, given in inputs.items()
        }
        session = self._method.stream(self._params, size, self._seed, references)
        if session is None:
            return None
        pictures = chain([first], rest)
        return (self._finished(session.step(frame_of(one, self.opacity)), one) for one in pictures)

    def _finished(self, painted: AnyArray, picture: AnyArray) -> AnyArray:
        """The frame that is returned or encoded, from what was painted of a picture."""
        if self.returns:
            return returned(painted, picture)
        return with_its_opacity(painted, picture) if self.opacity == "straight" else painted

    def _open_frames(self, name: str, source: Source) -> Iterator[AnyArray]:
        """The frames of the input `name`."""
        file = file_of(source)
        if file is None:
            return iter(cast("Iterable[AnyArray]", source))
        reader = self._stack.enter_context(opened(file))
        self._frames = reader.frames if name == "video" else self._frames
        return read_noting(reader, name, self._damage)

    def _planned(
        self, source: Source, inputs: Mapping[str, object], files: Mapping[str, bytes] | None = None
    ) -> Iterator[AnyArray]:  # fmt: skip
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="impasto-")))
        given: dict[str, Any] = {}
        video = self._source("video", source, folder)
        numbers = video.numbers if isinstance(video, FileFrames) else ()
        if files:
            given["video.entries"] = files
        for name, value in inputs.items():
            given |= self._input(self._specs[name], value, folder, numbers)
        if self.paints_opacity and video.has_alpha:
            given["matte"] = (
                video.showing("matte")
                if isinstance(video, SpooledFrames)
                else self._source("matte", showing(source, "matte"), folder)
            )
        context = DiskContext(self._params, video, given, self._seed, folder=folder)
        arrays = video.pictures if isinstance(video, SpooledFrames) else None
        context.deep = self.deep or (
            self.returns and arrays is not None and arrays.dtype != np.uint8 and self._method.depth_bits > 8
        )
        context.paints_opacity = self.paints_opacity
        context.ask_for_passes(self._method, self.output, numbers)
        if self._tell is not None:
            context.reports = Progress(self._weights(video.info.frames), self._tell)
        following = 0
        for step, task in iterate_plan(self._method, context):
            context.finish_passes()
            while following in context.emitted:
                painted = context.emitted.pop(following)
                yield painted if arrays is None else self._finished(painted, arrays[following])
                following += 1
            if context.reports is not None:
                context.reports.finished(step, task)
        if context.pass_files:
            unite([_kept(path) for path in context.pass_files], self.passes_file)
        for message in context.warnings:
            warnings.warn(message, MethodNotice, stacklevel=2)

    def _weights(self, frames: int) -> dict[str, float]:
        return {step.name: frames * step.weight for step in self._method.steps_of(self._params)}

    def _source(self, name: str, source: Source, folder: Path) -> FileFrames | SpooledFrames:
        if (file := file_of(source)) is not None:
            return FileFrames(file, self._stack, name, self._damage)
        number = sum(1 for _ in folder.iterdir())
        pictures = checked(iter(cast("Iterable[AnyArray]", source)))
        opacity = self.opacity if name == "video" else "white"
        return SpooledFrames(pictures, self._fps, folder / f"frames-{number}", opacity)

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


def _kept(path: Path) -> Part:
    return lambda: nullcontext(path)


def _many(value: Any) -> Source:
    """An input's pictures: one array is a video of one frame."""
    return [value] if isinstance(value, np.ndarray) and value.ndim in (2, 3) else value
