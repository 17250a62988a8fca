"""The inputs of a layer's film at the size of a preview: every picture is scaled like the video."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.base import VideoInfo
from pipeline.methods.local import Input
from workers.previews.model import LayerSources
from workers.previews.warm import WarmFrames

_PIECE_FRAMES = 4
"""Frames that are fetched at a time."""


class ScaledVideo:
    """A video at the size of a preview, as `pipeline.methods.local.FrameSource`."""

    def __init__(self, frames: WarmFrames, key: str, side_px: int) -> None:
        self._frames, self._key, self._side_px = frames, key, side_px

    @property
    def info(self) -> VideoInfo:
        whole = self._frames.info(self._key)
        height, width = self._frames.frame(self._key, 0, self._side_px).shape[:2]
        return replace(whole, width=width, height=height)

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        end = self._frames.info(self._key).frames
        end = end if stop is None else min(stop, end)
        for first in range(start, end, _PIECE_FRAMES):
            yield from self._frames.frames(self._key, first, min(first + _PIECE_FRAMES, end), self._side_px)


class ScaledImages(Mapping[int, AnyArray]):
    """Drawings by frame number, scaled on access; those of other sizes than the video are scaled by the same factor."""

    def __init__(self, images: Mapping[int, AnyArray], scale: float, size: tuple[int, int]) -> None:
        self._images, self._scale, self._size = images, scale, size

    def __getitem__(self, frame: int) -> AnyArray:
        image = self._images[frame]
        if self._scale == 1:
            return image
        size = round(image.shape[1] * self._scale), round(image.shape[0] * self._scale)
        return resized(image, self._size if _near(size, self._size) else (max(1, size[0]), max(1, size[1])))

    def __iter__(self) -> Iterator[int]:
        return iter(self._images)

    def __len__(self) -> int:
        return len(self._images)


class _Drawings(Mapping[int, AnyArray]):
    """A layer's drawings, decoded on access."""

    def __init__(self, frames: WarmFrames, sources: Mapping[int, str | bytes], field: str) -> None:
        self._frames, self._sources, self._field = frames, sources, field

    def __getitem__(self, frame: int) -> AnyArray:
        return self._frames.image(self._sources[frame], self._field)

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(self._sources))

    def __len__(self) -> int:
        return len(self._sources)


def layer_inputs(layer: LayerSources, frames: WarmFrames, side_px: int, exit_stack: ExitStack) -> dict[str, Input]:
    """The inputs by name, as for `pipeline.methods.local.LocalContext`; `exit_stack` closes the archives among them."""
    info, video = frames.info(layer.video), ScaledVideo(frames, layer.video, side_px)
    scale = min(1.0, side_px / max(info.width, info.height))
    size = (video.info.width, video.info.height)
    found: dict[str, Input] = {"video": video}
    kinds = {spec.name: spec.kind for spec in method(layer.method).inputs}
    for name, key in layer.files.items():
        if kinds[name] == "json":
            found[name] = frames.document(key, f"inputs.{name}")
        elif kinds[name] == "images":
            found[name] = ScaledImages(frames.archive(key, f"inputs.{name}", exit_stack), scale, size)
        else:
            whole = frames.info(key)
            found[name] = ScaledVideo(frames, key, max(1, round(max(whole.width, whole.height) * scale)))
    for name, sources in layer.images.items():
        if sources:
            found[name] = ScaledImages(_Drawings(frames, sources, f"inputs.{name}"), scale, size)
    found |= layer.documents
    found["video.passes"] = frames.entries(layer.video, exit_stack)
    found["video.pass_facts"] = frames.pass_facts(layer.video)
    if scale == 1:  # passes of a shot have the size of its frames
        found["video.entries"] = frames.entries(layer.video, exit_stack)
    return found


def resized(image: AnyArray, size: tuple[int, int]) -> AnyArray:
    """A drawing at (width, height). Colours are averaged; gray values (labels, masks) are those of the nearest
    pixel."""
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_AREA))


def _near(size: tuple[int, int], other: tuple[int, int]) -> bool:
    return abs(size[0] - other[0]) <= 1 and abs(size[1] - other[1]) <= 1
