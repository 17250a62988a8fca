"""Clusters of moving objects that a method finds before it paints, and the foreground spread from scribbles."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from pipeline.errors import BadParameter, MediaTooLarge
from pipeline.frames import Frame
from pipeline.methods import method, methods, parse_params
from pipeline.methods.base import AnyParams, FrameClusters, Method
from pipeline.methods.local import FrameSource, Input, iterate_plan
from pipeline.video.stills import encode_gray_png
from workers.previews.context import PreviewContext
from workers.previews.kinds.marks import moved_marks
from workers.previews.kinds.regions import MOST_PIXELS, VideoSource
from workers.previews.memory import PreviewTaskContext
from workers.previews.model import LayerSources, Record

REACH_FRAMES = 12
"""Maximum number of frames between scribbles and a later frame whose foreground is previewed. The film has no such
limit."""


def clusters(context: PreviewContext) -> Iterator[Record]:
    """A label map of every frame with the numbers that jobs find, and the uncertainty of each label.

    They are computed at full resolution, and cached. They do not depend on label maps that the user has corrected.
    """
    layer = context.query.layers[0]
    chosen = _method_with_clusters(layer)
    info = context.frames.info(layer.video)
    if info.frames * info.width * info.height > MOST_PIXELS:
        raise MediaTooLarge(
            "The video is too long to look for clusters while you wait.", field="video", value=info.frames,
            remedy="Paint the film: its clusters can be corrected then.",
        )  # fmt: skip
    plain = _for_clusters(chosen, layer)
    key = ("clusters", plain.digest)
    known: list[Record] | None = context.cache.peek(key)
    if known is not None:
        yield from known
        return
    made: list[Record] = []
    video = VideoSource(context, layer.video, info)
    for number, found in _found(context, chosen, plain, video, 0):
        made.append(_labels(number, found))
        yield made[-1]
        yield Record(
            {"type": "progress", "done": round(len(made) / max(info.frames, 1), 3), "note": "Finding clusters"}
        )
    if not made:
        name, value = next(iter(chosen.clusters_params.items()), ("", None))
        raise BadParameter("With these settings the method clusters no frames.", field=f"params.{name}".rstrip("."),
                           value=layer.params.get(name), remedy=f"Use {name} = {json.dumps(value)}.")  # fmt: skip
    context.cache.put(key, made, sum(len(record.payload) for record in made))


def spread(context: PreviewContext) -> Iterator[Record]:
    """A `mask` record of the frame and of each of those after it: white = foreground. None without scribbles at the
    frame or at most `REACH_FRAMES` before it. Of marks that move with the picture: `marks.moved_marks`."""
    layer, number = context.query.layers[0], context.options["frame"]
    if name := _moved(layer):
        yield from moved_marks(context, name)
        return
    chosen = _method_with_clusters(layer)
    plain = _for_clusters(chosen, layer)
    marked = [at for images in plain.images.values() for at in images if number - REACH_FRAMES <= at <= number]
    if not marked:
        return
    start = min(marked)
    stop = number + context.options["around"] + 1
    video = context.frames.frames(layer.video, start, stop, context.query.side_px)
    for at, found in _found(context, chosen, plain, video, start):
        if at >= number and found.foreground is not None:
            plane = np.where(found.foreground, 255, 0).astype(np.uint8)
            header = {"type": "mask", "frame": at, "width": plane.shape[1], "height": plane.shape[0],
                      "media_type": "image/png"}  # fmt: skip
            yield Record(header, encode_gray_png(plane))


def _moved(layer: LayerSources) -> str:
    """The input of the layer's method that has marks which move with the picture; empty: none."""
    chosen = method(layer.method)
    parts = [section.part for section in chosen.studio.sections if section.overlay and section.overlay.kind == "marks"]
    return next((spec.name for spec in chosen.inputs if spec.part.partition(".")[0] in parts), "")


def _method_with_clusters(layer: LayerSources) -> Method:
    chosen = method(layer.method)
    if not chosen.clusters_step:
        able = ", ".join(name for name, known in methods().items() if known.clusters_step) or "none"
        raise BadParameter(f"The method {layer.method!r} finds no clusters.", field="layer", value=layer.id,
                           remedy=f"Choose a method that does: {able}.")  # fmt: skip
    return chosen


def _for_clusters(chosen: Method, layer: LayerSources) -> LayerSources:
    """The layer with only the drawings on which clusters depend."""
    shown = [section.overlay for section in chosen.studio.sections if section.overlay is not None]
    parts = {part for overlay in shown if overlay.preview == "clusters" for part in overlay.after}
    names = {spec.name for spec in chosen.inputs if spec.part.partition(".")[0] in parts}
    images = {name: found for name, found in layer.images.items() if name in names}
    return replace(layer, images=images, documents={}, files={})


def _found(
    context: PreviewContext, chosen: Method, layer: LayerSources, video: Sequence[Frame] | FrameSource, start: int
) -> Iterator[tuple[int, FrameClusters]]:
    """(frame, clusters) by the method's plan up to `clusters_step`; `video` begins with frame `start`, and drawings of
    other frames are left out."""
    stop = start + (len(video) if isinstance(video, Sequence) else video.info.frames)
    inputs: dict[str, Input] = {
        name: {at - start: context.frames.image(source, f"inputs.{name}") for at, source in images.items()
               if start <= at < stop}
        for name, images in layer.images.items()
    }  # fmt: skip
    params: AnyParams = parse_params(chosen, layer.params)
    memory = PreviewTaskContext(context.check, params, video, inputs, layer.seed)
    steps = 1 + [step.name for step in chosen.steps].index(chosen.clusters_step)
    for step, task in iterate_plan(chosen, memory, steps=steps, forget=True):
        arrays = memory.kept.get((step, task.key)) if step == chosen.clusters_step else None
        for number, found in sorted(chosen.frame_clusters(arrays or {}).items()):
            yield start + number, found


def _labels(number: int, found: FrameClusters) -> Record:
    """Payload: gray PNG of 16 bit, value = label."""
    labels = found.labels.astype(np.uint16)
    header = {
        "type": "clusters", "frame": number, "width": labels.shape[1], "height": labels.shape[0],
        "media_type": "image/png", "uncertainty": {str(label): value for label, value in found.uncertainty.items()},
    }  # fmt: skip
    return Record(header, cv2.imencode(".png", labels)[1].tobytes())
