"""Flicker of a painting relative to its source: a map of one frame, and values for several frames.

The measures are those of the quality report (`pipeline.quality.coherence`), at the size of the preview.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from pipeline.frames import Frame
from pipeline.perception.cuts import is_cut, thumbnail
from pipeline.quality.coherence import PairMeasure, flicker_map, measure_pair
from pipeline.quality.sampling import sampled_pairs
from pipeline.video.stills import encode_gray_png
from workers.previews.context import PreviewContext
from workers.previews.kinds.paint import film
from workers.previews.model import Record

FULL_HEAT = 0.2
"""Warped difference in excess of the source's that is drawn as 255, as a share of the range of values."""
BLUR_PX = 1.5
Pair = tuple[Frame, Frame]


def flicker(context: PreviewContext) -> Iterator[Record]:
    """For one frame: the painted frame and a map of its flicker. For a range of frames: the flicker of each.

    The painted frames are those of the finished film that the query names, otherwise of previews.
    """
    span = context.options.get("frames")
    total = context.frames.info(context.query.layers[0].below).frames
    if span is None:
        yield from _map(context, min(context.options["frame"], total - 1))
        return
    start, stop = span[0], min(span[1], total)
    pairs = [start + second for second in sampled_pairs(stop - start, context.options["count"])]
    for number, source, painted in _pairs(context, pairs):
        measure = None if _cut(source) else measure_pair(source, painted)
        yield Record(_header(number, measure))


def _map(context: PreviewContext, number: int) -> Iterator[Record]:
    found = next(_pairs(context, [number]), None) if number else None
    if found is None or _cut(found[1]):
        yield Record(_header(number, None))
        return
    _, source, painted = found
    yield context.picture(number, painted[1], final=True)
    measure, plane = flicker_map(source, painted)
    heat = np.rint(cv2.GaussianBlur(plane, (0, 0), BLUR_PX) * (255 / FULL_HEAT)).clip(0, 255).astype(np.uint8)
    header = _header(number, measure) | {"width": heat.shape[1], "height": heat.shape[0], "media_type": "image/png"}
    yield Record(header, encode_gray_png(heat))


def _header(number: int, measure: PairMeasure | None) -> dict[str, object]:
    """`flicker` as in the quality report; `error`: the root mean square of the warped difference, 0..1. Both are null
    for the first frame of a shot, which follows no other."""
    if measure is None or not measure.visible_px:
        return {"type": "flicker", "frame": number, "flicker": None, "error": None}
    error = float(np.sqrt(measure.painted_error / (3 * measure.visible_px)))
    return {"type": "flicker", "frame": number, "flicker": round(measure.flicker, 3), "error": round(error, 5)}


def _cut(source: Pair) -> bool:
    return is_cut(thumbnail(source[0]), thumbnail(source[1]))


def _pairs(context: PreviewContext, seconds: list[int]) -> Iterator[tuple[int, Pair, Pair]]:
    """(frame, source frames, painted frames) of the pairs with these second frames that the painting has."""
    key, side = context.query.layers[0].below, context.query.side_px
    for number, painted in _painted_pairs(context, seconds):
        context.check()
        before, now = context.frames.frames(key, number - 1, number + 1, side)
        size = (now.shape[1], now.shape[0])
        yield number, (before, now), (_sized(painted[0], size), _sized(painted[1], size))


def _painted_pairs(context: PreviewContext, seconds: list[int]) -> Iterator[tuple[int, Pair]]:
    side = context.query.side_px
    if (finished := context.options.get("film")) is not None:
        first, count = context.options["film_start"], context.frames.info(finished).frames
        for number in seconds:
            at = number - first
            if 0 < at < count:
                before, now = context.frames.frames(finished, at - 1, at + 1, side)
                yield number, (before, now)
        return
    if not seconds:
        return
    previous: Frame | None = None
    wanted = sorted({at for second in seconds for at in (second - 1, second)})
    for number, picture in film(context, wanted, side):
        if previous is not None and number in seconds:
            yield number, (previous, picture)
        previous = picture


def _sized(picture: Frame, size: tuple[int, int]) -> Frame:
    if (picture.shape[1], picture.shape[0]) == size:
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
