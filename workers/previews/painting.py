"""Paints and composites frames of layers. Each layer uses the method's fastest way to paint one frame or a few."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.compositing import covers, lay_over
from pipeline.frames import Frame
from pipeline.methods import method, parse_params
from pipeline.methods.base import AnyParams, Method, PreviewRequest, Session
from workers.contract.request import Json
from workers.jobs.frame_window import window_document
from workers.previews.memory import Check, painted
from workers.previews.model import LayerSources
from workers.previews.warm import WarmFrames

LEAD_FRAMES = 2
"""Number of earlier frames that a causal method processes first, so that motion and temporal filters have an effect."""
KEY_REACH_FRAMES = 12
"""Maximum distance, in frames, of a painted key from which a single frame is previewed. The film has no such limit."""
REFERENCE_FRAMES = 24
Artefacts = Mapping[str, Mapping[str, bytes]]


class LayerPainter:
    """Paints frames of one layer.

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

    def frame(self, number: int, side_px: int) -> Frame:
        """Frame `number`, scaled to fit and painted: by the method's preview function, by its plan from the nearest
        painted key to this frame, by its stream, or by its plan over this frame alone."""
        total = self._frames.info(self._layer.video).frames
        number = min(number, total - 1)
        lead = self._frames.frames(self._layer.video, number - LEAD_FRAMES, number + 1, side_px)
        lead = lead or [self._frames.frame(self._layer.video, number, side_px)]
        self._check()
        if (own := self._by_method(lead, number, total)) is not None:
            return own
        if (key := self._nearest_key(number)) is not None:
            return dict(self.planned(min(key, number), max(key, number) + 1, side_px, {}))[number]
        if (streamed := self._streamed(lead, side_px)) is not None:
            return streamed
        params = self._params if total == 1 else self._method.single_frame_params(self._params)
        inputs = self._files(number, number + 1, self._scale(lead[-1]))
        size = (lead[-1].shape[1], lead[-1].shape[0])
        drawn = {name: self._images(name, number, number + 1) for name in self._layer.images}
        inputs |= {name: {0: resized(one[number], size)} for name, one in drawn.items() if one}
        return next(painted(self._method, params, self._layer.seed, lead[-1:], inputs, self._check))[1]

    def frames(self, start: int, stop: int, side_px: int) -> Iterator[tuple[int, Frame]]:
        """Yield frames [start, stop), each as soon as it is painted. A causal method continues from frame to frame; any
        other method runs its plan over these frames."""
        stop = min(stop, self._frames.info(self._layer.video).frames)
        probe = self._frames.frames(self._layer.video, start, start + 1, side_px)
        if self._documents() and type(self._method).preview is not Method.preview:
            for number in range(start, stop):
                yield number, self.frame(number, side_px)
        elif (session := self._session((probe[0].shape[1], probe[0].shape[0]), side_px)) is not None:
            yield from self._from_session(session, start, stop, side_px)
        else:
            yield from self.planned(start, stop, side_px, {})

    def planned(
        self, start: int, stop: int, side_px: int, images: Mapping[str, Mapping[int, AnyArray]]
    ) -> Iterator[tuple[int, Frame]]:
        """Frames [start, stop) by the method's plan over them, with the drawings of these frames.

        Args:
            images: input -> frame number -> drawing, of any size; they replace drawings of the layer.
        """
        video = self._frames.frames(self._layer.video, start, stop, side_px)
        inputs = self._files(start, stop, self._scale(video[0]))
        size = (video[0].shape[1], video[0].shape[0])
        for name in {*self._layer.images, *images}:
            drawn = {**self._images(name, start, stop), **images.get(name, {})}
            if drawn:
                inputs[name] = {frame - start: resized(image, size) for frame, image in sorted(drawn.items())}
        for name, value in self._documents().items():
            inputs[name] = window_document(value, (start, stop))
        for index, picture in painted(self._method, self._params, self._layer.seed, video, inputs, self._check):
            yield start + index, picture

    def _nearest_key(self, number: int) -> int | None:
        """The painted key that is nearest to a frame; None if there is none within `KEY_REACH_FRAMES`."""
        painted = self._layer.images.get(self._method.keys_input(), {})
        reached = [frame for frame in painted if abs(frame - number) <= KEY_REACH_FRAMES]
        return min(reached, key=lambda frame: (abs(frame - number), frame), default=None)

    def directions(self, number: int, side_px: int) -> tuple[NDArray[np.float32] | None, tuple[int, int]]:
        """Stroke directions of a frame (see `Method.directions`), and its size (width, height)."""
        total = self._frames.info(self._layer.video).frames
        number = min(number, total - 1)
        frame = self._frames.frame(self._layer.video, number, side_px)
        found = self._method.directions(self._request([frame], number, total))
        return found, (frame.shape[1], frame.shape[0])

    def _by_method(self, lead: Sequence[Frame], number: int, total: int) -> Frame | None:
        return self._method.preview(self._request(lead, number, total))

    def _request(self, lead: Sequence[Frame], number: int, total: int) -> PreviewRequest[AnyParams]:
        drawn = {name: self._images(name, 0, total) for name in self._layer.images}
        images: Mapping[str, Mapping[int, AnyArray]] = {**drawn, **self._archives}
        return PreviewRequest(
            self._params, self._layer.seed, lead, number, total, self._documents(), images, self._artefacts
        )

    def _from_session(self, session: Session, start: int, stop: int, side_px: int) -> Iterator[tuple[int, Frame]]:
        first = max(0, start - LEAD_FRAMES)
        for number, frame in enumerate(self._frames.frames(self._layer.video, first, stop, side_px), first):
            self._check()
            picture = session.step(frame)
            if number >= start:
                yield number, picture

    def _session(self, size: tuple[int, int], side_px: int) -> Session | None:
        references = {name: self._reference(key, side_px) for name, key in sorted(self._layer.files.items())
                      if self._kinds[name] not in ("json", "images")}  # fmt: skip
        return self._method.stream(self._params, size, self._layer.seed, references)

    def _streamed(self, lead: Sequence[Frame], side_px: int) -> Frame | None:
        session = self._session((lead[0].shape[1], lead[0].shape[0]), side_px)
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

    def _files(self, start: int, stop: int, scale: float) -> Json:
        """The inputs that are files, scaled like the video, so that strokes keep their size relative to the picture."""
        found: Json = {}
        for name, key in self._layer.files.items():
            if self._kinds[name] in ("image", "image-or-video"):
                found[name] = [self._shrunk(key, 0, scale)]
            elif self._kinds[name] == "video":
                found[name] = [self._shrunk(key, number, scale) for number in range(start, stop)]
        return found

    def _shrunk(self, key: str, number: int, scale: float) -> Frame:
        info = self._frames.info(key)
        return self._frames.frame(key, number, max(1, round(max(info.width, info.height) * scale)))

    def _documents(self) -> Json:
        given = {name: self._frames.document(key, f"inputs.{name}") for name, key in self._layer.files.items()
                 if self._kinds[name] == "json"}  # fmt: skip
        return {**given, **self._layer.documents}

    def _images(self, name: str, start: int, stop: int) -> dict[int, AnyArray]:
        found = self._layer.images.get(name, {})
        return {frame: self._frames.image(found[frame], f"inputs.{name}") for frame in found if start <= frame < stop}


def resized(image: AnyArray, size: tuple[int, int]) -> AnyArray:
    """A drawing at (width, height). Colours are averaged; gray values (labels, masks) are those of the nearest
    pixel."""
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_AREA))


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
