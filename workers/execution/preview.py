"""Previews of one stylised frame, for a page on which a user moves a slider."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from threading import Lock

from pydantic import JsonValue

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import AnyParams, Method, PreviewRequest
from pipeline.methods.local import LocalContext, run_plan
from pipeline.video.contact import fit
from pipeline.video.guard.files import GuardedImages
from pipeline.video.numbered import by_frame
from pipeline.video.stills import encode_png
from workers.blobs.base import Blobs
from workers.execution.decoders import Decoders, frame_at
from workers.execution.renderer import prepare_process
from workers.model import Asset, JobRequest, Json, asset_key

_REFERENCE_FRAMES = 24
_LEAD_FRAMES = 2
"""Number of earlier frames that a causal method processes first, so that motion and temporal filters have an effect."""


_Lead = tuple[list[Frame], int, int]
"""Consecutive frames, the number of the last one in the video, and the frame count of the video."""


@dataclass(frozen=True)
class PreviewAsk:
    """The frame to preview, and replacements of the request's inputs.

    Attributes:
        frame: number of the frame; the last one of a shorter video.
        max_side_px: longest side of the result; frames are never enlarged.
        documents: JSON documents that replace the inputs of these names.
        artefacts: artefacts of an earlier job: name -> blob key of a zip.
    """

    frame: int
    max_side_px: int
    documents: Mapping[str, Json] = field(default_factory=dict)
    artefacts: Mapping[str, str] = field(default_factory=dict)


class Previews:
    """Runs a causal method's stream over a frame and the two before it, scaled to fit; any other method over the frame
    alone. Thread-safe, one at a time."""

    def __init__(self, blobs: Blobs, find: Callable[[str], Method] = method) -> None:
        prepare_process()
        self._blobs = blobs
        self._decoders = Decoders(blobs)
        self._find = find
        self._lock = Lock()

    def close(self) -> None:
        self._decoders.close()

    def png(self, request: JobRequest, assets: Mapping[str, Asset], ask: PreviewAsk) -> bytes:
        """A frame of the request's video, stylised by its method, as PNG.

        Args:
            assets: input name -> asset. Those beside `video` that are pictures are the method's references.

        Raises: BadParameter (parameters, a design, painted keyframes), BadMedia.
        """
        chosen = self._find(request.method)
        params = parse_params(chosen, request.params)
        keys = {name: asset_key(asset.id) for name, asset in assets.items()}
        _refuse_inputs_without_effect(chosen, keys)
        with self._lock:
            frames, number, total = self._lead(keys["video"], ask.frame, ask.max_side_px)
            painted = self._by_method(chosen, params, request.seed, keys, (frames, number, total), ask)
            if painted is None and (ask.documents or ask.artefacts):
                name = next(iter({**ask.documents, **ask.artefacts}))
                raise BadParameter(f"The method {chosen.name!r} takes no {name}.", field=name, remedy="Leave it out.")
            if painted is None:
                painted = self._last(chosen, params, request.seed, keys, frames, ask.max_side_px)
            if painted is None:
                alone = params if total == 1 else chosen.single_frame_params(params)
                painted = self._alone(chosen, alone, request.seed, keys, frames[-1], number)
            return encode_png(painted)

    def _by_method(
        self, chosen: Method, params: AnyParams, seed: int, keys: Mapping[str, str], lead: _Lead, ask: PreviewAsk
    ) -> Frame | None:
        """The frame by the method's own preview function; None if the method has none."""
        kinds = {spec.name: spec.kind for spec in chosen.inputs}
        with ExitStack() as exit_stack:
            images: dict[str, Mapping[int, AnyArray]] = {}
            drawn = [name for name in keys if kinds.get(name) == "images"]
            numbers = self._numbers(keys["video"]) if drawn else ()
            for name in drawn:
                guarded = GuardedImages(exit_stack.enter_context(self._blobs.local(keys[name])), f"inputs.{name}")
                exit_stack.callback(guarded.close)
                images[name] = by_frame(guarded, numbers, f"inputs.{name}")
            given = {name: _json(self._blobs.get(keys[name]), name) for name in keys if kinds.get(name) == "json"}
            archives = {name: _archive(exit_stack, self._blobs, key) for name, key in ask.artefacts.items()}
            request = PreviewRequest(params, seed, *lead, given | dict(ask.documents), images, archives)
            return chosen.preview(request)

    def _numbers(self, key: str) -> tuple[int, ...]:
        with self._decoders.reader(key) as reader:
            return reader.index.numbers

    def _last(
        self, chosen: Method, params: AnyParams, seed: int, keys: Mapping[str, str], frames: list[Frame], side_px: int
    ) -> Frame | None:
        """The frame by the stream of a causal method."""
        size = (frames[0].shape[1], frames[0].shape[0])
        pictures = {spec.name for spec in chosen.inputs if spec.kind != "json" and spec.name != "video"}
        references = {name: self._reference(keys[name], side_px) for name in sorted(pictures & keys.keys())}
        session = chosen.stream(params, size, seed, references)
        return None if session is None else [session.step(frame) for frame in frames][-1]

    def _alone(
        self, chosen: Method, params: AnyParams, seed: int, keys: Mapping[str, str], frame: Frame, number: int
    ) -> Frame:
        """The frame by the plan of a method that is not causal."""
        with self._decoders.reader(keys["video"]) as reader:
            shrunk = max(frame.shape) / max(reader.size)
        given = [spec for spec in chosen.inputs if spec.name in keys and spec.kind not in ("json", "images")]
        pictures = {spec.name: self._picture(keys[spec.name], number, shrunk) for spec in given}
        return _alone_in_memory(chosen, params, seed, frame, pictures)

    def _picture(self, key: str, number: int, shrunk: float) -> Frame:
        with self._decoders.reader(key) as reader:
            frame = frame_at(reader, number)
        return fit(frame, max(1, round(max(frame.shape) * shrunk)))

    def _lead(self, key: str, frame: int, side_px: int) -> _Lead:
        """The frame and those before it; its number; how many there are."""
        with self._decoders.reader(key, max(0, frame - _LEAD_FRAMES)) as reader:
            last = min(max(frame, 0), reader.frames - 1)
            lead = [fit(f, side_px) for f in reader.read(max(0, last - _LEAD_FRAMES), last + 1)]
            return lead or [fit(frame_at(reader, last), side_px)], last, reader.frames

    def _reference(self, key: str, side_px: int) -> Iterator[Frame]:
        with self._decoders.reader(key) as reader:
            for frame in reader.read(0, _REFERENCE_FRAMES):
                yield fit(frame, side_px)


def _refuse_inputs_without_effect(chosen: Method, given: Container[str]) -> None:
    for spec in chosen.inputs:
        if spec.name in given and not spec.preview:
            raise BadParameter(
                f"The input {spec.name!r} has no effect on a preview of one frame.", field=f"inputs.{spec.name}",
                remedy="Render a few seconds, or preview without it.",
            )  # fmt: skip


def _json(data: bytes, name: str) -> JsonValue:
    try:
        parsed: JsonValue = json.loads(data)
    except ValueError as error:
        raise BadParameter(f"The input is not JSON: {error}.", field=f"inputs.{name}") from None
    return parsed


def _archive(exit_stack: ExitStack, blobs: Blobs, key: str) -> Mapping[str, bytes]:
    return ZipEntries(exit_stack.enter_context(zipfile.ZipFile(exit_stack.enter_context(blobs.local(key)))))


class ZipEntries(Mapping[str, bytes]):
    """The entries of an open zip archive by path, each read on access."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def __getitem__(self, name: str) -> bytes:
        return self._archive.read(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._archive.namelist())

    def __len__(self) -> int:
        return len(self._archive.namelist())


def _alone_in_memory(
    chosen: Method, params: AnyParams, seed: int, frame: Frame, pictures: Mapping[str, Frame]
) -> Frame:
    """The frame painted by the method's whole plan, as if it were the whole video.

    Args:
        pictures: the other inputs, scaled like the frame, so that strokes keep their size relative to the picture.
    """
    images = {spec.name for spec in chosen.inputs if spec.kind == "images"}
    inputs = {name: {0: picture} if name in images else [picture] for name, picture in pictures.items()}
    context = LocalContext(params, [frame], inputs, seed)
    run_plan(chosen, context)
    return context.emitted[0]
