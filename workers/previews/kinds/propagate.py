"""Propagates a painted key to the frames around it while the artist paints, to the nearest frames first."""

from __future__ import annotations

import logging
from collections.abc import Generator, Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput, BadParameter, Cancelled
from pipeline.frames import Frame
from pipeline.methods import method, methods
from workers.previews.context import PreviewContext
from workers.previews.inputs import resized
from workers.previews.kinds.regions import layer_film
from workers.previews.model import LayerSources, Overtaken, Record
from workers.previews.propagators import PROXY_SIDE_PX, forget_propagator, propagator_of

_LOG = logging.getLogger(__name__)

DRAFT_REACH_FRAMES = 12
"""Maximum distance, in frames, of a painted key that is carried to a frame for a draft of it."""


def propagate(context: PreviewContext) -> Iterator[Record]:
    """Frames key - around .. key + around, painted by the method's propagator at `PROXY_SIDE_PX` at most. If the method
    has none, or if it fails, they are painted by the method's plan over these frames."""
    layer, key = context.query.layers[0], context.options["key"]
    name = method(layer.method).keys_input()
    if not name:
        able = ", ".join(one for one, known in methods().items() if known.keys_input()) or "none"
        raise BadParameter(
            f"The method {layer.method!r} takes no painted keys.", field="layer", value=layer.id,
            remedy=f"Choose a method that does: {able}.",
        )  # fmt: skip
    if key >= (total := context.frames.info(layer.video).frames):
        raise BadParameter(
            "The video has no frame of this number.", field="key", value=key, remedy=f"Use 0 to {total - 1}."
        )
    side_px = min(context.query.side_px, PROXY_SIDE_PX)
    try:
        if (yield from _propagated(context, layer, name, side_px)):
            return
    except (BadInput, Cancelled, Overtaken):
        raise
    except Exception:
        _LOG.exception("The propagator of %r failed; its plan runs instead.", layer.method)
        forget_propagator(context, layer, side_px)
    yield from _planned(context, layer, name)


def _propagated(context: PreviewContext, layer: LayerSources, name: str, side_px: int) -> Generator[Record, None, bool]:
    """Yield the records; returns whether the method has a propagator.

    Frames with a painted key of their own, and frames beyond them, are left out, because this key does not affect them.
    """
    key = context.options["key"]
    around, span = _span(context, layer, name)
    with propagator_of(context, layer, side_px) as propagator:
        if propagator is None:
            return False
        image = _key_image(context, layer, name, side_px, key)
        if image is None:
            propagator.prepare(key, around)
            return True
        for number, picture in propagator.repaint(key, image, around):
            if number in span:
                yield context.picture(number, picture, final=True)
    return True


def _span(context: PreviewContext, layer: LayerSources, name: str) -> tuple[int, range]:
    """Number of frames to repaint on each side of the key, and the frames to show: those between its neighbour keys."""
    key, around = context.options["key"], context.options["around"]
    others = [frame for frame in layer.images.get(name, {}) if frame != key]
    start = max([key - around, *(frame + 1 for frame in others if frame < key)])
    stop = min([key + around + 1, *(frame for frame in others if frame > key)])
    return max(key - start, stop - 1 - key), range(start, stop)


def _key_image(
    context: PreviewContext, layer: LayerSources, name: str, side_px: int, key: int
) -> NDArray[np.uint8] | None:
    """The painted key, uint8 RGB or RGBA of the proxy frames' size; None if nothing is painted on that frame."""
    source = context.options.get("image") or layer.images.get(name, {}).get(key)
    if source is None:
        return None
    frame = context.frames.frame(layer.video, key, side_px)
    size = (frame.shape[1], frame.shape[0])
    drawing = context.frames.image(source, "image")
    mask = layer.images.get(method(layer.method).keys_input("mask"), {}).get(key)
    if isinstance(source, bytes) and drawing.ndim == 3 and drawing.shape[2] == 4:
        mask = None  # the present key has its present mask; the document's may be older
    return resized_key(drawing, None if mask is None else context.frames.image(mask, "inputs"), size)


def resized_key(drawing: AnyArray, mask: AnyArray | None, size: tuple[int, int]) -> NDArray[np.uint8]:
    """A drawing as uint8 RGB, or RGBA if it has opacity or a mask, at `size` (width, height).

    Args:
        drawing: gray, RGB or RGBA, 8 or 16 bit.
        mask: white where it is painted, in place of its opacity; of any size.
    """
    eight = _eight_bit(drawing)
    colours = np.dstack([eight] * 3) if eight.ndim == 2 else eight[..., :3]
    if mask is not None:
        opacity = resized(_plane(_eight_bit(mask)), (eight.shape[1], eight.shape[0]))
    elif eight.ndim == 3 and eight.shape[2] == 4:
        opacity = eight[..., 3]
    else:
        return np.ascontiguousarray(resized(colours, size))
    return _downscaled(np.ascontiguousarray(colours), np.ascontiguousarray(opacity), size)


def _downscaled(colours: NDArray[np.uint8], opacity: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """RGBA at `size`. Colours are averaged with opacity as weight, because transparent pixels have no meaningful
    colour."""
    if (colours.shape[1], colours.shape[0]) == size:
        return np.dstack([colours, opacity])
    weight = opacity.astype(np.float32) / 255
    total = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    summed = cv2.resize(colours * weight[..., None], size, interpolation=cv2.INTER_AREA)
    mean = np.rint(summed / np.maximum(total, 1e-6)[..., None]).clip(0, 255)
    return np.dstack([mean, np.rint(total * 255)]).astype(np.uint8)


def _eight_bit(image: AnyArray) -> NDArray[np.uint8]:
    return np.asarray(image if image.dtype == np.uint8 else image >> 8, np.uint8)


def _plane(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 0])


def _planned(context: PreviewContext, layer: LayerSources, name: str) -> Iterator[Record]:
    """The frames of the film with the key as it is now, nearest first."""
    key, around, image = context.options["key"], context.options["around"], context.options.get("image")
    keys = {**layer.images.get(name, {}), **({} if image is None else {key: image})}
    edited = replace(layer, images={**layer.images, name: keys})
    film = layer_film(context, edited, context.query.side_px)
    span = range(max(0, key - around), min(context.frames.info(layer.video).frames, key + around + 1))
    for number, picture in film.frames(sorted(span, key=lambda frame: (abs(frame - key), frame)), context.check):
        yield context.picture(number, picture, final=True)


def carried(context: PreviewContext, layer: LayerSources, number: int, side_px: int) -> Frame | None:
    """A draft of a frame: the nearest painted key, carried to it along the motion; None if no key is within
    `DRAFT_REACH_FRAMES`, or if the method has no propagator."""
    name = method(layer.method).keys_input()
    keys = layer.images.get(name, {})
    key = min(keys, key=lambda frame: (abs(frame - number), frame), default=number)
    if not name or abs(key - number) > DRAFT_REACH_FRAMES:
        return None
    side_px = min(side_px, PROXY_SIDE_PX)
    with propagator_of(context, layer, side_px) as propagator:
        image = _key_image(context, layer, name, side_px, key)
        if propagator is None or image is None:
            return None
        for at, picture in propagator.repaint(key, image, abs(key - number)):
            context.check()
            if at == number:
                return picture
    return None
