"""The task context of one layer within the job of all layers: its own inputs, artefacts and frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager

import numpy as np
from pydantic import JsonValue

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.errors import BadFrame
from pipeline.frames import Frame, Plane
from pipeline.methods import parse_params
from pipeline.methods.base import AnyParams, TaskContext, VideoInfo
from pipeline.methods.layers.names import VIDEO, input_name, prefix, stage
from pipeline.methods.layers.params import LayerParams, LayersParams
from pipeline.perception.cuts import thumbnail
from pipeline.video.depth import as_uint16
from pipeline.video.stills import encode_png

PIECE_FRAMES = 8
"""Frames of an artefact: multiples of this number begin a new one."""


class LayerContext:
    """`TaskContext` of a layer over that of the job. Emitted frames are kept as artefacts; call `finish` at the end.

    Args:
        number: of the layer, from the back, from 0.
    """

    def __init__(self, context: TaskContext[LayersParams], number: int, layer: LayerParams) -> None:
        self.params: AnyParams = parse_params(layer.chosen, layer.params)
        self.seed = layer.seed
        self._context, self._number = context, number
        self._stages = {step.name: stage(index) for index, step in enumerate(layer.chosen.steps_of(self.params))}
        self._frames: dict[str, AnyArray] = {}
        self._first = self._next = 0
        self.pieces: list[list[int]] = []
        """[start, stop) of every artefact of emitted frames."""

    @property
    def video(self) -> VideoInfo:
        return self._context.video

    @property
    def size(self) -> tuple[int, int]:
        return self._context.size

    # -- inputs

    def frames(self, name: str = VIDEO, start: int | None = None, stop: int | None = None) -> Iterator[Frame]:
        return self._sized(name, self._context.frames(self._own(name), *self._span(name, start, stop)))

    def _span(self, name: str, start: int | None, stop: int | None) -> tuple[int | None, int | None]:
        if name == VIDEO and self.video.is_piece:  # a layer's video of its own is no piece for the job
            start = self.video.first if start is None else start
            stop = self.video.stop if stop is None else stop
        return start, stop

    def _sized(self, name: str, frames: Iterator[AnyArray]) -> Iterator[AnyArray]:
        for frame in frames:
            if name == VIDEO and (frame.shape[1], frame.shape[0]) != self.size:
                raise BadFrame(
                    f"The video of layer {self._number} has another size than the shot's.",
                    field=self._own(name), value=f"{frame.shape[1]}x{frame.shape[0]}",
                    remedy=f"Scale it to {self.size[0]}x{self.size[1]}.",
                )  # fmt: skip
            yield frame

    @property
    def deep(self) -> bool:
        return self._context.deep

    def deep_frames(self, name: str = VIDEO, start: int | None = None, stop: int | None = None) -> Iterator[AnyArray]:
        return self._sized(name, self._context.deep_frames(self._own(name), *self._span(name, start, stop)))

    @property
    def paints_opacity(self) -> bool:
        return False

    def mattes(self, start: int, stop: int) -> Iterator[AnyArray] | None:
        return self._context.mattes(start, stop)

    def thumbnails(self, name: str = VIDEO, start: int | None = None, stop: int | None = None) -> Iterator[Plane]:
        return map(thumbnail, self.frames(name, start, stop))

    def has(self, name: str) -> bool:
        return self._context.has(self._own(name))

    def image(self, name: str) -> Frame:
        return self._context.image(self._own(name))

    def json(self, name: str) -> JsonValue:
        return self._context.json(self._own(name))

    def images(self, name: str) -> Mapping[int, AnyArray]:
        return self._context.images(self._own(name))

    def passes(self) -> Mapping[str, bytes]:
        own = self._own(VIDEO)
        return self._context.passes() if own == VIDEO else self._context.entries(own)

    @property
    def pass_facts(self) -> Mapping[str, JsonValue]:
        return self._context.pass_facts if self._own(VIDEO) == VIDEO else {}

    def entries(self, name: str) -> Mapping[str, bytes]:
        return self._context.entries(self._own(name))

    def _own(self, name: str) -> str:
        own = input_name(self._number, name)
        return VIDEO if name == VIDEO and not self._context.has(own) else own

    # -- artefacts

    def save(self, name: str, arrays: Arrays) -> None:
        self._context.save(prefix(self._number) + name, arrays)

    def load(self, step: str, name: str) -> State:
        return self._context.load(self._stages[step], prefix(self._number) + name)

    def save_file(self, name: str, data: bytes, media_type: str) -> None:
        self._context.save_file(prefix(self._number) + name, data, media_type)

    def warn(self, message: str) -> None:
        self._context.warn(f"Layer {self._number}: {message}")

    def wants(self, artefact: str) -> bool:
        return False

    def wants_pass(self, name: str) -> bool:
        return self._context.wants_pass(input_name(self._number, name))

    def emit_passes(self, index: int, made: Arrays) -> None:
        self._context.emit_passes(index, {input_name(self._number, name): array for name, array in made.items()})

    # -- frames

    def emit(self, index: int, frame: AnyArray) -> None:
        if not self.video.delivers(index):
            return
        if not self._frames:
            self._first = index
        elif index != self._next:
            raise BadFrame(f"Frame {self._next} must be emitted next.", field="emit", value=index)
        self._frames[str(index)] = np.frombuffer(
            encode_png(as_uint16(frame) if frame.dtype == np.float32 else frame), np.uint8
        )
        self._next = index + 1
        if self._next % PIECE_FRAMES == 0:
            self.finish()
        self.show(frame)

    def finish(self) -> None:
        """Save the emitted frames that are not saved yet."""
        if self._frames:
            self._context.save(frames_name(self._number, self._first), self._frames)
            self.pieces.append([self._first, self._next])
            self._frames = {}

    def show(self, frame: AnyArray) -> None:
        self._context.show(frame)

    # -- time

    def clock(self, stage: str) -> AbstractContextManager[None]:
        return self._context.clock(stage)

    def progress(self, done: float) -> None:
        self._context.progress(done)


def frames_name(layer: int, first: int) -> str:
    """Artefact with a layer's painted frames from `first` on: frame number -> PNG, uint8 (bytes,), of 8
    or 16 bits."""
    return f"{prefix(layer)}frames-{first:07d}"
