"""One stylised frame, now: what the page shows while a user moves a slider."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import FoundRegions, Method, Sketcher, sketcher
from pipeline.video.contact import fit
from pipeline.video.guard.files import GuardedImages
from pipeline.video.stills import encode_png
from workers.blobs.base import Blobs
from workers.decoders import Decoders
from workers.glimpse import glimpse
from workers.model import Asset, JobRequest, Json
from workers.orders import asset_key
from workers.render import prepare_process

_REFERENCE_FRAMES = 24
_LEAD_FRAMES = 2
"""Frames before the asked one that a causal method sees first, so that motion and memory count."""


@dataclass(frozen=True)
class PreviewAsk:
    """What is to be seen.

    Attributes:
        frame: of a shorter video, its last.
        max_side_px: longest side of the result; frames are never enlarged.
        design: a document instead of the input `design`.
        regions: blob key of an artefact "regions".
    """

    frame: int
    max_side_px: int
    design: Json | None = None
    regions: str | None = None


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
        """A frame of the request's video in its method's manner, PNG.

        Args:
            assets: input name -> asset. Those beside `video` that are pictures are the method's references.

        Raises: BadParameter (parameters, a design, painted keyframes), BadMedia.
        """
        chosen = self._find(request.method)
        params = parse_params(chosen, request.params)
        keys = {name: asset_key(asset.id) for name, asset in assets.items()}
        with self._lock:
            frames, number, total = self._lead(keys["video"], ask.frame, ask.max_side_px)
            if (draw := sketcher(chosen)) is not None:
                return encode_png(self._designed(draw, params, request.seed, keys, frames, number, total, ask))
            if ask.design is not None or ask.regions is not None:
                raise BadParameter("This method takes no design.", field="design", remedy="Leave it out.")
            painted = self._last(chosen, params, request.seed, keys, frames, ask.max_side_px)
            if painted is None:
                painted = self._alone(chosen, params, request.seed, keys, frames[-1], number)
            return encode_png(painted)

    def _designed(
        self, draw: Sketcher, params: Any, seed: int, keys: Mapping[str, str], frames: list[Frame], number: int,
        total: int, ask: PreviewAsk,
    ) -> Frame:  # fmt: skip
        with ExitStack() as life:
            masks = None
            if "masks" in keys:
                masks = GuardedImages(life.enter_context(self._blobs.local(keys["masks"])), "inputs.masks")
                life.callback(masks.close)
            document: Any = ask.design
            if document is None and "design" in keys:
                document = _json(self._blobs.get(keys["design"]))
            found = None
            if ask.regions is not None:
                path = life.enter_context(self._blobs.local(ask.regions))
                found = _found(life.enter_context(zipfile.ZipFile(path)))
            return draw(params, seed, frames, number, total, document=document, masks=masks, found=found)

    def _last(
        self, chosen: Method, params: Any, seed: int, keys: Mapping[str, str], frames: list[Frame], side_px: int
    ) -> Frame | None:
        """By a causal method."""
        size = (frames[0].shape[1], frames[0].shape[0])
        pictures = {spec.name for spec in chosen.inputs if spec.kind != "json" and spec.name != "video"}
        references = {name: self._reference(keys[name], side_px) for name in sorted(pictures & keys.keys())}
        session = chosen.stream(params, size, seed, references)
        return None if session is None else [session.step(frame) for frame in frames][-1]

    def _alone(
        self, chosen: Method, params: Any, seed: int, keys: Mapping[str, str], frame: Frame, number: int
    ) -> Frame:
        """By a method that needs the whole film."""
        if "keyframes" in keys:
            raise BadParameter(
                "Painted keyframes are seen in the film, not in a preview of one frame.", field="inputs.keyframes",
                remedy="Render a few seconds, or preview without them.",
            )  # fmt: skip
        with self._decoders.reader(keys["video"]) as reader:
            shrunk = max(frame.shape) / max(reader.size)
        given = [spec for spec in chosen.inputs if spec.name in keys and spec.kind not in ("json", "images")]
        pictures = {spec.name: self._picture(keys[spec.name], number, shrunk) for spec in given}
        return glimpse(chosen, params, seed, pictures | {"video": frame})

    def _picture(self, key: str, number: int, shrunk: float) -> Frame:
        with self._decoders.reader(key) as reader:
            at = min(number, reader.frames - 1)
            frame = next(reader.read(at, at + 1))
        return fit(frame, max(1, round(max(frame.shape) * shrunk)))

    def _lead(self, key: str, frame: int, side_px: int) -> tuple[list[Frame], int, int]:
        """The frame and those before it; its number; how many there are."""
        with self._decoders.reader(key, max(0, frame - _LEAD_FRAMES)) as reader:
            last = min(max(frame, 0), reader.frames - 1)
            lead = [fit(f, side_px) for f in reader.read(max(0, last - _LEAD_FRAMES), last + 1)]
            return lead, last, reader.frames

    def _reference(self, key: str, side_px: int) -> Iterator[Frame]:
        with self._decoders.reader(key) as reader:
            for frame in reader.read(0, _REFERENCE_FRAMES):
                yield fit(frame, side_px)


def _json(data: bytes) -> Any:
    try:
        return json.loads(data)
    except ValueError as error:
        raise BadParameter(f"The input is not JSON: {error}.", field="inputs.design") from None


def _found(archive: zipfile.ZipFile) -> FoundRegions:
    """What an artefact "regions" tells of tubes and objects."""
    listed = json.loads(archive.read("regions-list.json"))

    def tubes(frame: int) -> NDArray[np.int64]:
        try:
            data = archive.read(f"tubes-{frame:07d}.png")
        except KeyError:
            raise BadParameter("The job has no tubes of that frame.", field="regions_of", value=frame) from None
        coded = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.int64)
        return np.asarray(coded[..., 2] << 16 | coded[..., 1] << 8 | coded[..., 0], np.int64)

    return FoundRegions(tubes, {row["tube"]: row["object"] for row in listed["tubes"]})
