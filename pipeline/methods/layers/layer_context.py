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
        if name == VIDEO and self.video.is_piece:  # a layer's video of its own is no piece for the job
            start = self.video.first if start is None else start
            stop = self.video.stop if stop is None else stop
        for frame in self._context.frames(self._own(name), start, stop):
            if name == VIDEO and (frame.shape[1], frame.shape[0]) != self.size:
                raise BadFrame(
                    f"The video of layer {self._number} has another size than the shot's.",
                    field=self._own(name), value=f"{frame.shape[1]}x{frame.shape[0]}",
                    remedy=f"Scale it to {self.size[0]}x{self.size[1]}.",
                )  # fmt: skip
            yield frame

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

    # -- frames

    def emit(self, index: int, frame: Frame) -> None:
        if not self.video.delivers(index):
            return
        if not self._frames:
            self._first = index
        elif index != self._next:
            raise BadFrame(f"Frame {self._next} must be emitted next.", field="emit", value=index)
        self._frames[str(index)] = np.frombuffer(encode_png(frame), np.uint8)
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

    def show(self, frame: Frame) -> None:
        self._context.show(frame)

    # -- time

    def clock(self, stage: str) -> AbstractContextManager[None]:
        return self._context.clock(stage)

    def progress(self, done: float) -> None:
        self._context.progress(done)


def frames_name(layer: int, first: int) -> str:
    """Artefact with a layer's painted frames from `first` on: frame number -> PNG, uint8 (bytes,)."""
    return f"{prefix(layer)}frames-{first:07d}"
