"""What a method finds in a video before it paints: its artefact "regions", made at full resolution so that the numbers
are those that a job finds, and kept warm."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter, MediaTooLarge
from pipeline.frames import Frame
from pipeline.methods import method
from pipeline.methods.base import VideoInfo
from pipeline.methods.local import iterate_plan
from workers.previews.context import PreviewContext
from workers.previews.memory import PreviewTaskContext
from workers.previews.model import LayerSources, Record

ARTEFACT = "regions"
MOST_PIXELS = 400_000_000
"""Pixels of all frames together that are looked through for a preview: 434 frames of 720p."""
Files = Mapping[str, bytes]


def known_artefacts(context: PreviewContext, layer: LayerSources) -> dict[str, Files]:
    """Artefacts of the layer's video that are warm."""
    found = {name: context.cache.peek(_key(layer, name)) for name in method(layer.method).artefacts}
    return {name: files for name, files in found.items() if files is not None}


def regions(context: PreviewContext) -> Iterator[Record]:
    """The map of a frame as PNG, and every tube and object that is in it."""
    layer = context.query.layers[0]
    if ARTEFACT not in method(layer.method).artefacts:
        raise BadParameter(f"The method {layer.method!r} finds no regions.", field="layer", value=layer.id,
                           remedy="Choose a method with the artefact regions, such as multistyle.")  # fmt: skip
    files = context.cache.peek(_key(layer, ARTEFACT))
    if files is None:
        made: dict[str, bytes] = {}
        yield from _made(context, layer, made)
        files = made
        context.cache.put(_key(layer, ARTEFACT), made, sum(map(len, made.values())))
    yield from _shown(context, files)


def _key(layer: LayerSources, artefact: str) -> tuple[str, ...]:
    return "artefact", layer.method, layer.video, artefact


def _made(context: PreviewContext, layer: LayerSources, into: dict[str, bytes]) -> Iterator[Record]:
    """Run the method's plan up to its last step, which paints; parameters are the defaults."""
    chosen, info = method(layer.method), context.frames.info(layer.video)
    if info.frames * info.width * info.height > MOST_PIXELS:
        raise MediaTooLarge(
            "The video is too long to look for regions while you wait.", field="video", value=info.frames,
            remedy="Render a job with the artefact regions, or use outlines and label maps.",
        )  # fmt: skip
    frames = _Video(context, layer.video, info)
    memory = PreviewTaskContext(context.check, chosen.Params(), frames, {}, 0, frozenset({ARTEFACT}))
    for step, _ in iterate_plan(chosen, memory, steps=len(chosen.steps) - 1):
        yield Record({"type": "progress", "done": round(min(frames.read_to / max(info.frames, 1), 1), 3), "note": step})
    for name, data in memory.files.items():
        if name.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                into |= {entry: archive.read(entry) for entry in archive.namelist()}
        else:
            into[name] = data


class _Video:
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


def _shown(context: PreviewContext, files: Files) -> Iterator[Record]:
    number, side = context.options["frame"], context.query.side_px
    name = f"tubes-{number:07d}.png"
    if name not in files:
        raise BadParameter("The video has no such frame.", field="frame", value=number, remedy="Use one of its frames.")
    coded = _fit(np.asarray(cv2.imdecode(np.frombuffer(files[name], np.uint8), cv2.IMREAD_COLOR)), side)
    header = {"type": "map", "kind": "tubes", "frame": number, "width": coded.shape[1], "height": coded.shape[0],
              "media_type": "image/png", "colours": "rgb24"}  # fmt: skip
    yield Record(header, cv2.imencode(".png", coded)[1].tobytes())
    numbers = coded[..., 2].astype(np.int64) << 16 | coded[..., 1].astype(np.int64) << 8 | coded[..., 0]
    listed = json.loads(files[f"{ARTEFACT}-list.json"])
    yield Record({"type": "regions", "frame": number, **_rows(numbers, listed["tubes"])})


def _fit(image: NDArray[Any], side_px: int) -> NDArray[Any]:
    scale = side_px / max(image.shape[:2])
    if scale >= 1:
        return image
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST))


def _rows(numbers: NDArray[np.int64], listed: list[dict[str, Any]]) -> dict[str, Any]:
    """Tubes and objects of a frame: area in px of the map, and the box [left, top, right, bottom)."""
    owner = {row["tube"]: row["object"] for row in listed}
    tubes = {str(tube): {"object": owner[tube], **_extent(numbers == tube)}
             for tube in np.unique(numbers).tolist() if tube in owner}  # fmt: skip
    objects: dict[str, Any] = {}
    for part in sorted({row["object"] for row in tubes.values()}):
        mine = [int(tube) for tube, row in tubes.items() if row["object"] == part]
        objects[str(part)] = {"tubes": mine, **_extent(np.isin(numbers, mine))}
    return {"tubes": tubes, "objects": objects}


def _extent(inside: NDArray[np.bool_]) -> dict[str, Any]:
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    box = [int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1]
    return {"area": int(np.count_nonzero(inside)), "box": box}
