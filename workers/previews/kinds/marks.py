"""What a user has marked on a frame, in the frames after it, as the film has it there (`Method.move_marks`)."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods import method, parse_params
from workers.previews.context import PreviewContext
from workers.previews.model import Record

REACH_FRAMES = 240
"""Maximum number of frames between marks and a later frame in which they are previewed. The film has no such limit."""
PIECE = 16
"""Frames that are read together."""


def moved_marks(context: PreviewContext, name: str) -> Iterator[Record]:
    """A `mask` record, gray values with opacity, of the frame and of each of those after it in which something is
    marked.

    Args:
        name: the layer's input that has the marks.
    """
    layer, number = context.query.layers[0], context.options["frame"]
    chosen = method(layer.method)
    params, drawn = parse_params(chosen, layer.params), layer.images.get(name, {})
    wanted = range(number, number + context.options["around"] + 1)
    side = context.query.side_px
    key = ("marks", layer.digest, side)
    reach = range(max(number - REACH_FRAMES, 0), number + 1)
    begin = max((at for at in reach if at in drawn or context.cache.peek((*key, at)) is not None), default=wanted.stop)
    marks: Plane | None = None
    before: Frame | None = None
    for at, frame in _frames(context, begin, wanted.stop, side):
        if (marked := context.cache.peek((*key, at))) is not None:
            marks = marked.copy()
        else:
            image = context.frames.image(drawn[at], f"inputs.{name}") if at in drawn else None
            marks = chosen.move_marks(params, marks, frame if before is None else before, frame, image)
            if marks is not None:
                context.cache.put((*key, at), marks, marks.nbytes)
        before = frame
        if at in wanted and marks is not None:
            yield _mark(at, marks)


def _frames(context: PreviewContext, start: int, stop: int, side: int) -> Iterator[tuple[int, Frame]]:
    for first in range(start, stop, PIECE):
        context.check()
        found = context.frames.frames(context.query.layers[0].video, first, min(first + PIECE, stop), side)
        yield from enumerate(found, first)


def _mark(number: int, marks: Plane) -> Record:
    weight = np.clip(marks[..., 1], 0, 1)
    gray = np.clip(marks[..., 0] / np.maximum(weight, np.float32(1e-3)), 0, 1)
    picture = np.rint(255 * np.dstack([gray, gray, gray, weight])).astype(np.uint8)
    header = {"type": "mask", "frame": number, "width": picture.shape[1], "height": picture.shape[0],
              "media_type": "image/png"}  # fmt: skip
    return Record(header, cv2.imencode(".png", picture)[1].tobytes())
