"""One stylised frame, now: what the page shows while a user moves a slider."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from threading import Lock
from typing import Any

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method
from pipeline.video.contact import fit
from pipeline.video.stills import encode_png
from workers.blobs.base import Blobs
from workers.decoders import Decoders
from workers.model import Asset, JobRequest
from workers.orders import asset_key
from workers.render import prepare_process

_REFERENCE_FRAMES = 24
_LEAD_FRAMES = 2
"""Frames before the asked one that a causal method sees first, so that motion and memory count."""


class Previews:
    """Runs a causal method's stream over a frame and the two before it, scaled to fit. Thread-safe, one at a time."""

    def __init__(self, blobs: Blobs, find: Callable[[str], Method] = method) -> None:
        prepare_process()
        self._decoders = Decoders(blobs)
        self._find = find
        self._lock = Lock()

    def close(self) -> None:
        self._decoders.close()

    def png(self, request: JobRequest, assets: Mapping[str, Asset], frame: int, max_side_px: int) -> bytes:
        """Frame `frame` of the request's video in its method's manner, PNG; of a shorter video, its last frame.

        Args:
            assets: input name -> asset. Those beside `video` that are pictures are the method's references.
            max_side_px: longest side of the result; frames are never enlarged.

        Raises: BadParameter (parameters, a method that is not causal), BadMedia.
        """
        chosen = self._find(request.method)
        params = parse_params(chosen, request.params)
        keys = {name: asset_key(asset.id) for name, asset in assets.items()}
        with self._lock:
            frames = self._lead(keys["video"], frame, max_side_px)
            return encode_png(self._last(chosen, params, request.seed, keys, frames, max_side_px))

    def _last(
        self, chosen: Method, params: Any, seed: int, keys: Mapping[str, str], frames: list[Frame], side_px: int
    ) -> Frame:
        size = (frames[0].shape[1], frames[0].shape[0])
        pictures = {spec.name for spec in chosen.inputs if spec.kind != "json" and spec.name != "video"}
        references = {name: self._reference(keys[name], side_px) for name in sorted(pictures & keys.keys())}
        session = chosen.stream(params, size, seed, references)
        if session is None:
            raise BadParameter("This method has no preview of one frame.", field="method", value=chosen.name)
        return [session.step(frame) for frame in frames][-1]

    def _lead(self, key: str, frame: int, side_px: int) -> list[Frame]:
        with self._decoders.reader(key, max(0, frame - _LEAD_FRAMES)) as reader:
            last = min(max(frame, 0), reader.frames - 1)
            return [fit(f, side_px) for f in reader.read(max(0, last - _LEAD_FRAMES), last + 1)]

    def _reference(self, key: str, side_px: int) -> Iterator[Frame]:
        with self._decoders.reader(key) as reader:
            for frame in reader.read(0, _REFERENCE_FRAMES):
                yield fit(frame, side_px)
