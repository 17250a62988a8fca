"""The stage of the studio over a case: its preview of frames, without files and processes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.compositing import Blend
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.layers import LAYERS
from pipeline.methods.layers.names import MATTE, input_name
from pipeline.methods.local import DEFAULT_FPS, Input, LocalContext, run_plan
from tests.laws.cases import Case
from tests.laws.ways import Frames, film
from workers.previews.artefact_files import ArtefactFiles
from workers.previews.byte_cache import ByteCache
from workers.previews.context import PreviewContext
from workers.previews.inputs import layer_inputs
from workers.previews.kinds import paint
from workers.previews.kinds.regions import layer_film
from workers.previews.model import LayerSources, PreviewQuery
from workers.previews.warm import WarmFrames

VIDEO = "video"
STILLS = ("images", "json")


@dataclass(frozen=True)
class Layer:
    """A layer of the shot of a case. `matte`: the frames of its matte."""

    case: Case
    opacity: float = 1.0
    blend: Blend = "over"
    matte: Sequence[Frame] | None = None


@dataclass(frozen=True)
class _Reader:
    """Frames in memory, as the reader of a file has them."""

    held: Sequence[Frame]
    fps: float = DEFAULT_FPS

    @property
    def size(self) -> tuple[int, int]:
        return self.held[0].shape[1], self.held[0].shape[0]

    @property
    def frames(self) -> int:
        return len(self.held)

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        yield from (frame.copy() for frame in self.held[start:stop])


class MemoryFrames(WarmFrames):
    """The inputs of layers in memory: "video", and "<layer>/<input>"; a drawing is "<layer>/<input>/<frame>"."""

    def __init__(self, layers: Sequence[Layer], cache: ByteCache) -> None:
        self._cache = cache
        self._held: dict[str, Any] = {VIDEO: layers[0].case.film()}
        for number, layer in enumerate(layers):
            self._held |= {f"{number}/{name}": given for name, given in layer.case.given().items()}
            self._held |= {f"{number}/{MATTE}": layer.matte} if layer.matte is not None else {}

    def image(self, source: str | bytes, field: str) -> AnyArray:
        key, _, frame = str(source).rpartition("/")
        return cast("AnyArray", self._held[key][int(frame)]).copy()

    def archive(self, key: str, field: str, exit_stack: ExitStack) -> Mapping[int, AnyArray]:
        return {number: image.copy() for number, image in self._held[key].items()}

    def entries(self, key: str, exit_stack: ExitStack) -> Mapping[str, bytes]:
        return {}

    def document(self, key: str, field: str) -> Any:
        return self._held[key]

    def _reader(self, key: str, start: int) -> AbstractContextManager[Any]:
        return nullcontext(_Reader(self._held[key]))


@dataclass(frozen=True)
class Stage:
    """A preview of the layers.

    Attributes:
        side_px: longest side of its pictures.
        drawn: whether drawings and documents are the project's own; otherwise they are files.
        cache_bytes, disk_bytes: of what previews keep.
    """

    layers: Sequence[Layer]
    side_px: int
    drawn: bool = True
    cache_bytes: int = 1 << 26
    disk_bytes: int = 1 << 30

    def frames(self, numbers: Sequence[int]) -> Frames:
        """These frames, asked for one after another."""
        with closing(ArtefactFiles(self.disk_bytes)) as artefacts:
            context = self._context(artefacts)
            return {number: dict(paint.film(context, [number], self.side_px))[number] for number in numbers}

    def plan(self) -> Frames:
        """The film of the first layer by the whole plan over the pictures that the stage has at its size."""
        with closing(ArtefactFiles(self.disk_bytes)) as artefacts, ExitStack() as exit_stack:
            context, case = self._context(artefacts), self.layers[0].case
            film = layer_film(context, context.query.layers[0], self.side_px)
            inputs = dict(layer_inputs(context.query.layers[0], context.frames, self.side_px, exit_stack))
            inputs = dict(case.chosen.scaled_inputs(inputs, film._regions)) if self.side_px < max(case.size) else inputs
            video: Any = inputs.pop(VIDEO)
            local = LocalContext(case.parsed, video, inputs, seed=case.seed)
            run_plan(case.chosen, local)
            return local.emitted

    def _context(self, artefacts: ArtefactFiles) -> PreviewContext:
        cache = ByteCache(self.cache_bytes)
        layers = tuple(self._sources(number, layer) for number, layer in enumerate(self.layers))
        query = PreviewQuery("paint", "prj", "client", "stage", 1, layers, self.side_px)
        return PreviewContext(query, MemoryFrames(self.layers, cache), cache, artefacts, lambda: None, time.monotonic())

    def _sources(self, number: int, layer: Layer) -> LayerSources:
        case, given = layer.case, layer.case.given()
        kinds = {spec.name: spec.kind for spec in case.chosen.inputs}
        own = [name for name in case.inputs if self.drawn and kinds[name] in STILLS]
        files = {name: f"{number}/{name}" for name in case.inputs if name not in own}
        images = {
            name: {frame: f"{number}/{name}/{frame}" for frame in cast("Mapping[int, Any]", given[name])}
            for name in own if kinds[name] == "images"
        }  # fmt: skip
        documents: Any = {name: given[name] for name in own if kinds[name] == "json"}
        matte = f"{number}/{MATTE}" if layer.matte is not None else None
        return LayerSources(
            f"l{number}", case.method, case.params, case.seed, VIDEO, files, images, documents,
            layer.opacity, layer.blend, matte, VIDEO,
        )  # fmt: skip


PARTS = (4, 3)
"""Columns and rows of the parts of a frame whose mean colours are compared between a small preview and the film."""


def half_of_film(case: Case, number: int) -> float:
    """Mean difference between the stage at half the size and the film, of the mean colours of the parts of a frame,
    gray levels. Strokes lie elsewhere at another size, so that single pixels differ by up to 12 levels."""
    small = Stage([Layer(case)], max(case.size) // 2).frames([number])[number]
    whole, half = (
        cv2.resize(frame.astype(np.float32), PARTS, interpolation=cv2.INTER_AREA)
        for frame in (film(case)[number], small)
    )
    return float(np.abs(whole - half).mean())


def composited_film(layers: Sequence[Layer]) -> Frames:
    """The film of a shot of several layers, by the plan of the job that paints them together."""
    chosen, rows, inputs = method(LAYERS), list[dict[str, Any]](), dict[str, Input]()
    for number, layer in enumerate(layers):
        case = layer.case
        rows.append({"method": case.method, "params": case.params, "seed": case.seed, "opacity": layer.opacity,
                     "blend": layer.blend, "matted": layer.matte is not None})  # fmt: skip
        inputs |= {input_name(number, name): given for name, given in case.given().items()}
        inputs |= {input_name(number, MATTE): layer.matte} if layer.matte is not None else {}
    context = LocalContext(parse_params(chosen, {"layers": rows}), layers[0].case.film(), inputs)
    run_plan(chosen, context)
    return context.emitted
