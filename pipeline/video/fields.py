"""Deinterlacing with FFmpeg's filter bwdif: one frame for each picture, from it and its two neighbours.

Source: J. Weston, T. Mosler: w3fdif and yadif combined, FFmpeg's `vf_bwdif`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from fractions import Fraction

import av
from av.filter import Graph

from pipeline.video.container import finished
from pipeline.video.media import Fields

Numbered = tuple[int, av.VideoFrame]
"""Frame number and picture."""
_PARITY: dict[str, str] = {"auto": "auto", "top": "tff", "bottom": "bff"}
_TICK = Fraction(1, 1000)


class EarlierNeeded(Exception):
    """The first picture of a pass is interlaced: its frame depends on the picture before it."""


def is_interlaced(picture: av.VideoFrame, fields: Fields) -> bool:
    """Whether a picture is to be deinterlaced."""
    return fields in ("top", "bottom") or (fields == "auto" and picture.interlaced_frame)


def deinterlaced(
    pictures: Iterator[Numbered], fields: Fields, begins: bool = True, leads: bool = False
) -> Iterator[Numbered]:
    """The pictures, those that are interlaced replaced by frames. Others pass unchanged and without delay.

    Args:
        begins: whether the first picture is the first one of the video.
        leads: whether the first picture only serves as the neighbour of the second one, if it is interlaced.

    Raises: EarlierNeeded, unless `begins` or `leads`.
    """
    before: av.VideoFrame | None = None
    filtering: _Bwdif | None = None
    first = not begins
    for number, picture in pictures:
        interlaced = is_interlaced(picture, fields)
        if first and interlaced:
            if not leads:
                raise EarlierNeeded
            before, first = picture, False
            continue
        first = False
        if filtering is not None and not filtering.fits(picture):
            yield from filtering.rest()
            filtering, before = None, None
        if interlaced and filtering is None:
            filtering = _Bwdif(picture, fields)
            if before is not None and filtering.fits(before):
                filtering.push(None, before)
        if filtering is not None:
            yield from filtering.push(number if interlaced else None, picture)
        if not interlaced:
            filtering = None
            yield number, picture
        before = picture
    if filtering is not None:
        yield from filtering.rest()


class _Bwdif:
    """One run of pictures of the same size and format through the filter."""

    def __init__(self, like: av.VideoFrame, fields: Fields) -> None:
        self._key = _kind(like)
        graph = Graph()
        graph.threads = 1
        self._source = graph.add_buffer(width=like.width, height=like.height, format=like.format, time_base=_TICK)
        which = "interlaced" if fields == "auto" else "all"
        made = graph.add("bwdif", f"mode=send_frame:parity={_PARITY[fields]}:deint={which}")
        self._sink = graph.add("buffersink")
        graph.link_nodes(self._source, made, self._sink).configure()
        self._graph, self._pushed = graph, 0
        self._waiting: deque[int | None] = deque()

    def fits(self, picture: av.VideoFrame) -> bool:
        return _kind(picture) == self._key

    def push(self, number: int | None, picture: av.VideoFrame) -> list[Numbered]:
        """The frames that are finished. Pictures without a number are neighbours only."""
        pts, base = picture.pts, picture.time_base
        picture.pts, picture.time_base = self._pushed, _TICK
        self._pushed += 1
        self._waiting.append(number)
        self._source.push(picture)
        picture.pts = pts
        if base is not None:
            picture.time_base = base
        return self._finished()

    def rest(self) -> list[Numbered]:
        self._source.push(None)
        return self._finished()

    def _finished(self) -> list[Numbered]:
        numbered = [(self._waiting.popleft(), frame) for frame in finished(self._sink)]
        return [(number, frame) for number, frame in numbered if number is not None]


def _kind(picture: av.VideoFrame) -> tuple[int, int, str, int, int]:
    return picture.width, picture.height, picture.format.name, int(picture.colorspace), int(picture.color_range)
