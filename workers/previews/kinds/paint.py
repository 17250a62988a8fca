"""Painted frames, the video's own frames, and cards of styles."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.frames import Frame
from workers.previews.context import PreviewContext
from workers.previews.kinds.regions import known_artefacts
from workers.previews.model import LayerSources, Record
from workers.previews.painting import LayerPainter, composited

COARSE_SIDE_PX = 288
"""Longest side of the first, coarse picture."""
COARSE_FROM_PX = 480
"""Least side, px, of a picture that is preceded by a coarse one; a smaller picture takes hardly longer than a coarse
one."""


def source(context: PreviewContext) -> Iterator[Record]:
    """The video itself."""
    start, stop, step = _span(context)
    key, side = context.query.layers[0].video, context.query.side_px
    for number in range(start, stop, step):
        context.check()
        yield context.picture(number, context.frames.frame(key, number, side), final=True)


def paint(context: PreviewContext) -> Iterator[Record]:
    """Painted frames. A single frame is painted coarsely first, then at the requested size; a crop is painted at full
    resolution."""
    if (crop := context.options.get("crop")) is not None:
        yield _cropped(context, crop)
        return
    start, stop, step = _span(context)
    info = context.frames.info(context.query.layers[0].video)
    side = min(context.query.side_px, max(info.width, info.height))
    if stop - start == 1:
        if context.options.get("coarse", True) and side >= COARSE_FROM_PX:
            yield context.picture(start, _painted(context, start, COARSE_SIDE_PX), final=False)
            context.check()
        yield context.picture(start, _painted(context, start, side), final=True)
        return
    for number, picture in film(context, start, stop, side):
        if (number - start) % step == 0:
            yield context.picture(number, picture, final=True)


def styles(context: PreviewContext) -> Iterator[Record]:
    """The frame in every style of a set: `options["cards"]` is a list of (id, layer)."""
    number, side = context.options["frame"], context.query.side_px
    for card, layer in context.options["cards"]:
        context.check()
        painted = LayerPainter(layer, context.frames, context.check).frame(number, side)
        yield context.picture(number, painted, final=True, card=card)


def _span(context: PreviewContext) -> tuple[int, int, int]:
    frames = context.options.get("frames")
    total = context.frames.info(context.query.layers[0].video).frames
    if frames is None:
        number = min(context.options.get("frame", 0), total - 1)
        return number, number + 1, 1
    return min(frames[0], total - 1), min(frames[1], total), context.options.get("step", 1)


def _painted(context: PreviewContext, number: int, side_px: int) -> Frame:
    layers = context.query.layers
    painted = [_layer(context, layer, number, side_px) for layer in layers]
    return composited(painted, layers, context.frames, number, side_px)


def _layer(context: PreviewContext, layer: LayerSources, number: int, side_px: int) -> Frame:
    artefacts = known_artefacts(context, layer)
    key = ("painted", layer.digest, number, side_px, tuple(artefacts))
    return context.cache.get(
        key,
        lambda: LayerPainter(layer, context.frames, context.check, artefacts).frame(number, side_px),
        lambda frame: frame.nbytes,
    ).copy()


def film(context: PreviewContext, start: int, stop: int, side_px: int) -> Iterator[tuple[int, Frame]]:
    """Painted frames [start, stop) in order, each with its number."""
    layers = context.query.layers
    films = [LayerPainter(layer, context.frames, context.check).frames(start, stop, side_px) for layer in layers]
    for painted in zip(*films, strict=False):
        number = painted[0][0]
        yield number, composited([picture for _, picture in painted], layers, context.frames, number, side_px)


def _cropped(context: PreviewContext, crop: tuple[int, int, int, int]) -> Record:
    """A piece of the frame as it will be in the film. The whole frame is painted, once, because the size of strokes
    depends on the height of the picture."""
    x, y, width, height = crop
    number, _, _ = _span(context)
    info = context.frames.info(context.query.layers[0].video)
    whole = _painted(context, number, max(info.width, info.height))
    piece = whole[y : y + height, x : x + width]
    return context.picture(number, piece.copy(), final=True, scale=1.0, crop=list(crop))


__all__ = ["film", "paint", "source", "styles"]
