"""Drafts of frames, before the film's own tasks have painted them, and the composite of layers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.compositing import covers, lay_over
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import AnyParams, Method, PreviewRequest
from workers.contract.request import Json
from workers.previews.inputs import resized
from workers.previews.memory import Check, painted
from workers.previews.model import LayerSources
from workers.previews.warm import WarmFrames

LEAD_FRAMES = 2
"""Number of earlier frames that a causal method processes first, so that motion and temporal filters have an effect."""
REFERENCE_FRAMES = 24
Artefacts = Mapping[str, Mapping[str, bytes]]


class LayerPainter:
    """Paints drafts of frames of one layer: quickly, and without what other frames of the film contribute.

    Args:
        artefacts: earlier results for the video: artefact -> path -> file.
        archives: open archives of images: input -> frame -> image, decoded on access.
    """

    def __init__(
        self, layer: LayerSources, frames: WarmFrames, check: Check, artefacts: Artefacts | None = None,
        archives: Mapping[str, Mapping[int, AnyArray]] | None = None,
    ) -> None:  # fmt: skip
        self._layer, self._frames, self._check, self._artefacts = layer, frames, check, artefacts or {}
        self._archives = archives or {}
        self._method: Method = method(layer.method)
        self._params = parse_params(self._method, layer.params)
        self._kinds = {spec.name: spec.kind for spec in self._method.inputs}

    def draft(self, number: int, side_px: int) -> Frame:
        """Frame `number`, scaled to fit and painted: by the method's preview function, by its stream, or by its plan
        over this frame alone."""
        total = self._frames.info(self._layer.video).frames
        number = min(number, total - 1)
        lead = self._frames.frames(self._layer.video, number - LEAD_FRAMES, number + 1, side_px)
        lead = lead or [self._frames.frame(self._layer.video, number, side_px)]
        self._check()
        if (own := self._by_method(lead, number, total)) is not None:
            return own
        if (streamed := self._streamed(lead, number, side_px)) is not None:
            return streamed
        params = self._params.at(number)
        params = params if total == 1 else self._method.single_frame_params(params)
        size = (lead[-1].shape[1], lead[-1].shape[0])
        inputs = self._files(number, self._scale(lead[-1]))
        drawn = {name: self._images(name, number, number + 1) for name in self._layer.images}
        inputs |= {name: {0: resized(one[number], size)} for name, one in drawn.items() if one}
        return next(painted(self._method, params, self._layer.seed, lead[-1:], inputs, self._check))[1]

    def directions(self, number: int, side_px: int) -> NDArray[np.float32] | None:
        """Stroke directions of a frame, see `Method.directions`."""
        total = self._frames.info(self._layer.video).frames
        number = min(number, total - 1)
        frame = self._frames.frame(self._layer.video, number, side_px)
        return self._method.directions(self._request([frame], number, total))

    def _by_method(self, lead: Sequence[Frame], number: int, total: int) -> Frame | None:
        return self._method.preview(self._request(lead, number, total))

    def _request(self, lead: Sequence[Frame], number: int, total: int) -> PreviewRequest[AnyParams]:
        drawn = {name: self._images(name, 0, total) for name in self._layer.images}
        images: Mapping[str, Mapping[int, AnyArray]] = {**drawn, **self._archives}
        return PreviewRequest(
            self._params.at(number), self._layer.seed, lead, number, total, self._documents(), images, self._artefacts
        )

    def _streamed(self, lead: Sequence[Frame], number: int, side_px: int) -> Frame | None:
        pictures = {name: self._reference(key, side_px) for name, key in sorted(self._layer.files.items())
                    if self._kinds[name] not in ("json", "images")}  # fmt: skip
        size = (lead[0].shape[1], lead[0].shape[0])
        session = self._method.stream(
            self._params.at(number), size, self._layer.seed, {**pictures, **self._documents()}
        )
        if session is None:
            return None
        picture: Frame | None = None
        for frame in lead:
            self._check()
            picture = session.step(frame)
        return picture

    def _reference(self, key: str, side_px: int) -> Iterator[Frame]:
        yield from self._frames.frames(key, 0, REFERENCE_FRAMES, side_px)

    def _scale(self, frame: Frame) -> float:
        info = self._frames.info(self._layer.video)
        return float(max(frame.shape) / max(info.width, info.height))

    def _files(self, number: int, scale: float) -> Json:
        """The inputs that are files, scaled like the video, so that strokes keep their size relative to the picture."""
        still = {"image": 0, "image-or-video": 0, "video": number}
        return {name: [self._downscaled(key, still[self._kinds[name]], scale)]
                for name, key in self._layer.files.items() if self._kinds[name] in still}  # fmt: skip

    def _downscaled(self, key: str, number: int, scale: float) -> Frame:
        info = self._frames.info(key)
        return self._frames.frame(key, number, max(1, round(max(info.width, info.height) * scale)))

    def _documents(self) -> Json:
        given = {name: self._frames.document(key, f"inputs.{name}") for name, key in self._layer.files.items()
                 if self._kinds[name] == "json"}  # fmt: skip
        return {**given, **self._layer.documents}

    def _images(self, name: str, start: int, stop: int) -> dict[int, AnyArray]:
        found = self._layer.images.get(name, {})
        return {frame: self._frames.image(found[frame], f"inputs.{name}") for frame in found if start <= frame < stop}


def composited(
    painted: Sequence[Frame], layers: Sequence[LayerSources], frames: WarmFrames, number: int, side_px: int
) -> Frame:
    """Composite the layers' pictures of a frame from back to front over the video."""
    covered = covers(layers[0].opacity, layers[0].blend, layers[0].matte is not None)
    out = None if covered else frames.frame(layers[0].below, number, side_px)
    for picture, layer in zip(painted, layers, strict=True):
        matte = None if layer.matte is None else frames.frame(layer.matte, number, side_px)[..., 0]
        out = picture if out is None else lay_over(out, picture, layer.opacity, layer.blend, matte)
    assert out is not None
    return out
