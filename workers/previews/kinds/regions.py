"""Regions that a method finds in a video before it paints (`Method.frame_regions`).

They are computed at full resolution, so that their numbers equal those of a job, and cached.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from pipeline.errors import BadParameter, MediaTooLarge
from pipeline.frames import Frame
from pipeline.methods import method, methods
from pipeline.methods.base import VideoInfo
from pipeline.methods.local import iterate_plan
from workers.previews.context import PreviewContext
from workers.previews.film import Kept, PreviewFilm
from workers.previews.memory import PreviewTaskContext
from workers.previews.model import LayerSources, Record

MOST_PIXELS = 400_000_000
"""Maximum number of pixels, over all frames, that are searched for a preview: 434 frames of 720p."""
Files = Mapping[str, bytes]


def known_artefacts(context: PreviewContext, layer: LayerSources) -> dict[str, Files]:
    """Cached artefacts of the layer's video."""
    found = {name: context.cache.peek(_key(layer, name)) for name in method(layer.method).artefacts}
    return {name: files for name, files in found.items() if files is not None}


def layer_film(context: PreviewContext, layer: LayerSources, side_px: int) -> PreviewFilm:
    """The film of a layer at the size of a preview."""
    kept = Kept(context.frames, context.cache, context.artefacts)
    return PreviewFilm(layer, kept, side_px, lambda: _files(context, layer))


def _files(context: PreviewContext, layer: LayerSources) -> Files:
    """Entries of the method's `regions_artefact`; computed if they are not cached."""
    artefact = method(layer.method).regions_artefact
    files: Files | None = context.cache.peek(_key(layer, artefact))
    if files is None:
        made: dict[str, bytes] = {}
        for _ in _made(context, layer, artefact, made):
            context.check()
        files = made
        context.cache.put(_key(layer, artefact), made, sum(map(len, made.values())))
    return files


def regions(context: PreviewContext) -> Iterator[Record]:
    """The map of a frame as PNG, and every region and object in it; with the option `film`, the regions of the layer's
    own design as the film has them. BadParameter if the method finds no regions."""
    layer = context.query.layers[0]
    artefact = method(layer.method).regions_artefact
    if not artefact:
        able = ", ".join(name for name, known in methods().items() if known.regions_artefact) or "none"
        raise BadParameter(f"The method {layer.method!r} finds no regions.", field="layer", value=layer.id,
                           remedy=f"Choose a method that does: {able}.")  # fmt: skip
    if context.options.get("film"):
        yield from _of_film(context, layer)
        return
    files = context.cache.peek(_key(layer, artefact))
    if files is None:
        made: dict[str, bytes] = {}
        yield from _made(context, layer, artefact, made)
        files = made
        context.cache.put(_key(layer, artefact), made, sum(map(len, made.values())))
    yield from _shown(context, layer, files)


def _of_film(context: PreviewContext, layer: LayerSources) -> Iterator[Record]:
    """The number of each pixel's region as gray PNG, and the regions' names; nothing if the layer has no regions."""
    number = context.options["frame"]
    found = layer_film(context, layer, context.query.side_px).plane("regions", number, context.check)
    if found is not None:
        height, width = found.plane.shape
        header = {"type": "map", "kind": "design", "frame": number, "width": width, "height": height,
                  "media_type": "image/png", "colours": "gray8", "names": list(found.names)}  # fmt: skip
        yield Record(header, cv2.imencode(".png", found.plane)[1].tobytes())


def _key(layer: LayerSources, artefact: str) -> tuple[str, ...]:
    return "artefact", layer.method, layer.video, artefact


def _made(context: PreviewContext, layer: LayerSources, artefact: str, into: dict[str, bytes]) -> Iterator[Record]:
    """Run the method's plan up to its last step, which paints; parameters are the defaults."""
    chosen, info = method(layer.method), context.frames.info(layer.video)
    if info.frames * info.width * info.height > MOST_PIXELS:
        raise MediaTooLarge(
            "The video is too long to look for regions while you wait.", field="video", value=info.frames,
            remedy=f"Render a job with the artefact {artefact}, or use outlines and label maps.",
        )  # fmt: skip
    frames = VideoSource(context, layer.video, info)
    memory = PreviewTaskContext(context.check, chosen.Params(), frames, {}, 0, frozenset({artefact}))
    titles = {step.name: step.title for step in chosen.steps}
    for step, _ in iterate_plan(chosen, memory, steps=len(chosen.steps) - 1):
        yield Record(
            {"type": "progress", "done": round(min(frames.read_to / max(info.frames, 1), 1), 3), "note": titles[step]}
        )
    for name, data in memory.files.items():
        if name.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                into |= {entry: archive.read(entry) for entry in archive.namelist()}
        else:
            into[name] = data


class VideoSource:
    """A video at full resolution, as `pipeline.methods.local.FrameSource`."""

    def __init__(self, context: PreviewContext, key: str, info: VideoInfo) -> None:
        self._context, self._key, self.info = context, key, info
        self.read_to = 0

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        end = self.info.frames if stop is None else stop
        for number, frame in enumerate(self._context.frames.stream(self._key, start, end), start):
            self._context.check()
            self.read_to = max(self.read_to, number + 1)
            yield frame


def _shown(context: PreviewContext, layer: LayerSources, files: Files) -> Iterator[Record]:
    number, side = context.options["frame"], context.query.side_px
    found = method(layer.method).frame_regions(files, number)
    if found is None:
        raise BadParameter(
            "The video has no frame of this number.", field="frame", value=number, remedy="Use one of its frames."
        )
    numbers = _fit(found.numbers.astype(np.int32), side)
    coded = np.dstack([numbers & 0xFF, numbers >> 8 & 0xFF, numbers >> 16]).astype(np.uint8)
    header = {"type": "map", "kind": "tubes", "frame": number, "width": coded.shape[1], "height": coded.shape[0],
              "media_type": "image/png", "colours": "rgb24"}  # fmt: skip
    yield Record(header, cv2.imencode(".png", coded)[1].tobytes())
    yield Record({"type": "regions", "frame": number, **_rows(numbers, found.objects)})


def _fit(image: NDArray[np.int32], side_px: int) -> NDArray[np.int32]:
    scale = side_px / max(image.shape[:2])
    if scale >= 1:
        return image
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST), np.int32)


def _rows(numbers: NDArray[np.int32], owner: Mapping[int, int]) -> dict[str, JsonValue]:
    """Regions and objects of a frame: area in px of the map, and the box [left, top, right, bottom);
    of an object also all its regions, including those of other frames."""
    inside = {number: numbers == number for number in np.unique(numbers).tolist() if number in owner}
    tubes: dict[str, JsonValue] = {
        str(number): {"object": owner[number], **_extent(mask)} for number, mask in inside.items()
    }
    objects: dict[str, JsonValue] = {}
    for one in sorted({owner[number] for number in inside}):
        mine = sorted(number for number, found in owner.items() if found == one)
        objects[str(one)] = {"tubes": list[JsonValue](mine), **_extent(np.isin(numbers, mine))}
    return {"tubes": tubes, "objects": objects}


def _extent(inside: NDArray[np.bool_]) -> dict[str, JsonValue]:
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    box: list[JsonValue] = [int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1]
    return {"area": int(np.count_nonzero(inside)), "box": box}
