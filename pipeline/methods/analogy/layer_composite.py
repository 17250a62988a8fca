"""The step `composite`: lays the layers of a shot over each other, from back to front."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.compositing import lay_over
from pipeline.compute import device
from pipeline.frames import Frame, Mask
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.render_passes import RenderPasses
from pipeline.methods.analogy.shot_layers import Layer, layered_shot, paint_artefact
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.distance import extrapolated, nearest, within_reach
from pipeline.synthesis.images import Bytes
from pipeline.video.writer import zip_entry


def run_composite(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Composite the layers of a run of frames over the background colour of shot.json; emit the frames.

    Each layer has an opacity and a blend mode. Layers with `"stylise": false` are composited as they were rendered, as
    the solid colours of fig. 8d of benard2013stylizing. A layer continues a few pixels under the silhouettes of the
    layers in front of it, so that no background shows where their paint does not reach their outline.
    """
    assert task.emits is not None
    shot = layered_shot(context)
    assert shot is not None
    start, stop = task.emits
    archive = _LayerArchive(shot.layers)
    passes = [RenderPasses(layer, context.size) for layer in shot.layers]
    for index in range(start, stop):
        canvas = _plain_canvas(context.size, shot.settings.background)
        in_front = _in_front(shot.layers, passes, index)
        for layer, source, front in zip(shot.layers, passes, in_front, strict=True):
            with context.clock("composite"):
                picture = _picture(context, layer, source, index)
                canvas = _with_layer(canvas, _continued(picture, front), layer)
            if context.wants(LAYERS):
                archive.add(layer, index, picture)
        context.emit(index, canvas)
        context.progress((index + 1 - start) / (stop - start))
    if context.wants(LAYERS):
        context.save_file(f"{LAYERS}-{start:07d}.zip", archive.close(), "application/zip")
    return {"frames": stop - start}


LAYERS = "layers"
"""Name of the artefact with each layer's pictures, with opacity."""


class _LayerArchive:
    """Zip of RGBA pictures with straight alpha, `01-NAME/0000012.png`; layers are numbered from back to front."""

    def __init__(self, layers: Sequence[Layer]) -> None:
        self._bytes = io.BytesIO()
        self._zip = zipfile.ZipFile(self._bytes, "w", zipfile.ZIP_STORED)
        self._folders = {layer.number: f"{layer.number + 1:02d}-{re.sub('[^0-9A-Za-z_-]', '_', layer.name)}"
                         for layer in layers}  # fmt: skip

    def add(self, layer: Layer, index: int, picture: Bytes) -> None:
        coded = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA))[1].tobytes()
        self._zip.writestr(zip_entry(f"{self._folders[layer.number]}/{index:07d}.png"), coded)

    def close(self) -> bytes:
        self._zip.close()
        return self._bytes.getvalue()


def _picture(context: TaskContext[AnalogyParams], layer: Layer, passes: RenderPasses, index: int) -> Bytes:
    """The painting of a layer, or its own frame if it is not stylised: uint8 (h, w, 4), straight alpha."""
    if layer.stylised:
        return np.asarray(context.load("synthesise", paint_artefact(layer.number, index))["rgba"], np.uint8)
    return passes.layer_picture(index)


CONTINUED_PX = 4
"""Distance to which a layer continues under those in front of it, px."""


def _in_front(layers: Sequence[Layer], passes: Sequence[RenderPasses], index: int) -> list[Mask | None]:
    """For each layer from back to front, the pixels of the silhouettes that hide it in a frame; None = none."""
    found: list[Mask | None] = []
    front: Mask | None = None
    for layer, source in zip(reversed(layers), reversed(passes), strict=True):
        found.append(front)
        settings = layer.files.settings
        hides = settings is None or (settings.blend == "over" and settings.opacity == 1)
        mask = source.mask(index) if hides else None
        front = mask if front is None else front if mask is None else front | mask
    return found[::-1]


def _continued(picture: Bytes, front: Mask | None) -> Bytes:
    """A layer with the colours of its nearest opaque pixels under the layers in front of it."""
    opaque = picture[..., 3] == 255
    if front is None or not (open_ := front & ~opaque).any() or not opaque.any():
        return picture
    sites = nearest(opaque, device(), CONTINUED_PX)
    reached = open_ & within_reach(sites, CONTINUED_PX)
    return np.where(reached[..., None], extrapolated(picture, sites), picture)


def _with_layer(canvas: Frame, picture: Bytes, layer: Layer) -> Frame:
    """A layer laid over the layers behind it."""
    settings = layer.files.settings
    colours, matte = np.ascontiguousarray(picture[..., :3]), picture[..., 3]
    if settings is None:
        return lay_over(canvas, colours, matte=matte)
    return lay_over(canvas, colours, settings.opacity, settings.blend, matte)


def _plain_canvas(size: tuple[int, int], colour: str) -> Frame:
    """A canvas of one colour "#rrggbb", uint8 (h, w, 3)."""
    return np.full((size[1], size[0], 3), list(bytes.fromhex(colour[1:])), np.uint8)
