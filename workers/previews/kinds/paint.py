"""Frames of the film, the video's own frames, and cards of styles."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

from pipeline.frames import Frame
from pipeline.methods import method
from workers.previews.context import PreviewContext
from workers.previews.costs import cost_record
from workers.previews.film import PreviewFilm
from workers.previews.kinds.propagate import carried
from workers.previews.kinds.regions import known_artefacts, layer_film
from workers.previews.memory import Check
from workers.previews.model import LayerSources, Record
from workers.previews.painting import LayerPainter, composited
from workers.previews.streaming import streamed

DRAFT_SIDE_PX = 288
"""Longest side of a draft."""
CARD_SIDE_PX = 200
"""Longest side of a card that may be a draft; larger ones are compared on the stage."""
DRAFT_FROM_PIXELS = 1_000_000
"""A film with fewer pixels, over all its frames, is painted hardly later than a draft."""
TELL_FROM_S, TELL_EVERY_S = 3.0, 0.2
"""Seconds before the first record of progress, and between two of them."""


def source(context: PreviewContext) -> Iterator[Record]:
    """The video itself."""
    start, stop, step = _span(context)
    key, side = context.query.layers[0].video, context.query.side_px
    for number in range(start, stop, step):
        context.check()
        yield context.picture(number, context.frames.frame(key, number, side), final=True)


def paint(context: PreviewContext) -> Iterator[Record]:
    """Frames of the film at the requested size; of a crop, at full resolution. A single frame that takes long is
    preceded by a draft, which is not `final`, and by records of progress."""
    start, stop, step = _span(context)
    info = context.frames.info(context.query.layers[0].video)
    whole = max(info.width, info.height)
    side = whole if context.options.get("crop") else min(context.query.side_px, whole)
    if stop - start > 1:
        for number, picture in film(context, range(start, stop, step), side):
            yield context.picture(number, picture, final=True)
        yield from _costs(context, side)
        return
    if context.options.get("coarse", True) and (draft := _draft(context, start, side)) is not None:
        yield draft
        context.check()

    def work(put: Callable[[Record], None], check: Check) -> None:
        _paint_one(context, start, side, put, check)

    yield from streamed(work, context.check)
    yield from _costs(context, side)


def _costs(context: PreviewContext, side_px: int) -> Iterator[Record]:
    """What the layers' films cost, for estimates."""
    for layer, film in zip(context.query.layers, _films(context, side_px), strict=True):
        if (cost := film.cost()) is not None:
            yield cost_record(layer, cost)


def styles(context: PreviewContext) -> Iterator[Record]:
    """The frame in every style of a set: `options["cards"]` is a list of (id, layer)."""
    number, side = context.options["frame"], context.query.side_px
    for card, layer in context.options["cards"]:
        context.check()
        yield context.picture(number, _card(context, layer, number, side), final=True, card=card)


def _card(context: PreviewContext, layer: LayerSources, number: int, side_px: int) -> Frame:
    """A draft where it is small and there is one, else the film's frame."""
    draft = _layer_draft(context, layer, number, side_px) if side_px <= CARD_SIDE_PX else None
    if draft is not None:
        return draft
    return next(layer_film(context, layer, side_px).frames([number], context.check))[1]


def _span(context: PreviewContext) -> tuple[int, int, int]:
    frames = context.options.get("frames")
    total = context.frames.info(context.query.layers[0].video).frames
    if frames is None:
        number = min(context.options.get("frame", 0), total - 1)
        return number, number + 1, 1
    return min(frames[0], total - 1), min(frames[1], total), context.options.get("step", 1)


def _films(context: PreviewContext, side_px: int) -> list[PreviewFilm]:
    return [layer_film(context, layer, side_px) for layer in context.query.layers]


def film(context: PreviewContext, numbers: Sequence[int], side_px: int) -> Iterator[tuple[int, Frame]]:
    """Frames of the film in order, each with its number."""
    layers = context.query.layers
    films = [one.frames(numbers, context.check) for one in _films(context, side_px)]
    for painted in zip(*films, strict=False):
        number = painted[0][0]
        yield number, composited([picture for _, picture in painted], layers, context.frames, number, side_px)


def _paint_one(context: PreviewContext, number: int, side_px: int, put: Callable[[Record], None], check: Check) -> None:
    """Hand over a frame of the film as soon as it is painted; the tasks that paint it are then finished."""
    *below, last = _films(context, side_px)
    told, sent = _Told(put), False
    pictures = [picture for one in below for _, picture in one.frames([number], check, told)]

    def send(at: int, picture: Frame) -> None:
        nonlocal sent
        if at == number and not sent:
            sent = told.ended = True
            whole = composited([*pictures, picture], context.query.layers, context.frames, number, side_px)
            put(_picture(context, number, whole, final=True))

    for _, picture in last.frames([number], check, told, send):
        send(number, picture)


class _Told:
    """Hands over records of progress, not too many.

    Attributes:
        ended: whether the frame is there, so that the rest of its tasks needs no telling.
    """

    def __init__(self, put: Callable[[Record], None]) -> None:
        self._put, self._next = put, time.monotonic() + TELL_FROM_S
        self.ended = False

    def __call__(self, note: str, done: float) -> None:
        if (now := time.monotonic()) >= self._next and not self.ended:
            self._next = now + TELL_EVERY_S
            self._put(Record({"type": "progress", "done": round(done, 3), "note": note}))


def _draft(context: PreviewContext, number: int, side_px: int) -> Record | None:
    """A draft of the frame; None if the frame is painted already or soon, or if there is no honest draft."""
    layers = context.query.layers
    films = _films(context, side_px)
    missing = [one for one in films if one.peek(number) is None]
    if sum(one.pixels for one in missing) < DRAFT_FROM_PIXELS:
        return None
    side = side_px if context.options.get("crop") else min(DRAFT_SIDE_PX, side_px)
    painted = [_layer_draft(context, layer, number, side) for layer in layers]
    if any(picture is None for picture in painted):
        return None
    found = [picture for picture in painted if picture is not None]
    return _picture(context, number, composited(found, layers, context.frames, number, side), final=False)


def _layer_draft(context: PreviewContext, layer: LayerSources, number: int, side_px: int) -> Frame | None:
    if method(layer.method).keys_input() in layer.images:
        return carried(context, layer, number, side_px)
    artefacts = known_artefacts(context, layer)
    return context.cache.get(
        ("draft", layer.digest, number, side_px, tuple(artefacts)),
        lambda: LayerPainter(layer, context.frames, context.check, artefacts).draft(number, side_px),
        lambda frame: frame.nbytes,
    ).copy()


def _picture(context: PreviewContext, number: int, picture: Frame, *, final: bool) -> Record:
    """The picture, or the crop of it that was asked for."""
    if (crop := context.options.get("crop")) is None:
        return context.picture(number, picture, final=final)
    x, y, width, height = crop
    piece = picture[y : y + height, x : x + width].copy()
    return context.picture(number, piece, final=final, scale=1.0, crop=list(crop))
