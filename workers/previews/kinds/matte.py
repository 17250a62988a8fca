"""The matte of objects that a user has clicked in some frames of a shot, in every frame of it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Any, TypeVar

import numpy as np

from pipeline.errors import MediaTooLarge
from pipeline.frames import Frame, Plane
from pipeline.regions.object_matte import ObjectMark, follow_marks
from pipeline.video.stills import encode_gray_png
from workers.previews.byte_cache import ByteCache
from workers.previews.context import PreviewContext
from workers.previews.model import Record

T = TypeVar("T")
MOST_PIXELS = 2_000_000_000
"""Maximum number of pixels, over all frames, through which an object is followed for a preview: 964 frames of 1080p."""


def matte(context: PreviewContext) -> Iterator[Record]:
    """A `mask` record for each wanted frame, at the size of the video: white = the objects. Frames before the first
    mark come after it, backwards; the frame that the user sees comes first, where that is possible."""
    video = context.query.layers[0].video
    info = context.frames.info(video)
    start, end = context.options["frames"] or (0, info.frames)
    end = min(end, info.frames)
    if (end - start) * info.width * info.height > MOST_PIXELS:
        most = MOST_PIXELS // (info.width * info.height)
        raise MediaTooLarge(
            "The shot is too long to follow an object while you wait.", field="frames", value=end - start,
            remedy=f"Follow it through at most {most} frames: split the shot.",
        )  # fmt: skip

    def read(first: int, stop: int) -> Iterator[Frame]:
        for frame in context.frames.stream(video, first, stop):
            context.check()
            yield frame

    marks = [
        ObjectMark(mark["frame"], mark["box"] and tuple(mark["box"]), mark["erase"], tuple(map(tuple, mark["stroke"])))
        for mark in context.options["marks"]
    ]
    memory = _Memory(context.cache, video)
    shown = -1 if context.options["frame"] is None else context.options["frame"]
    for done, found in enumerate(follow_marks(marks, (start, end), read, shown, memory), 1):
        png = memory.get(("png", found.frame, found.key), lambda alpha=found.alpha: _png(alpha()))  # type: ignore[misc]
        header = {"type": "mask", "frame": found.frame, "width": info.width, "height": info.height,
                  "media_type": "image/png"}  # fmt: skip
        yield Record(header, png)
        yield Record({"type": "progress", "done": round(done / (end - start), 3), "note": "Following the object"})


class _Memory:
    """Keeps reduced frames, motion and masks of a video in the cache of previews, for its next matte."""

    def __init__(self, cache: ByteCache, video: str) -> None:
        self._cache, self._video = cache, video

    def peek(self, key: Hashable) -> Any:
        return self._cache.peek(("matte", self._video, key))

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        return self._cache.get(("matte", self._video, key), make, _size)


def _size(value: object) -> int:
    """Bytes of an array, of arrays in a tuple, or of a file."""
    if isinstance(value, tuple):
        return sum(_size(one) for one in value)
    return value.nbytes if isinstance(value, np.ndarray) else len(value) if isinstance(value, bytes) else 8


def _png(alpha: Plane) -> bytes:
    return encode_gray_png(np.rint(255 * alpha).astype(np.uint8))
