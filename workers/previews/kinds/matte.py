"""The matte of objects that a user has clicked in some frames of a shot, in every frame of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.errors import MediaTooLarge
from pipeline.frames import Frame
from pipeline.regions.object_matte import ObjectMark, follow_marks
from pipeline.video.stills import encode_gray_png
from workers.previews.context import PreviewContext
from workers.previews.model import Record

MOST_PIXELS = 2_000_000_000
"""Maximum number of pixels, over all frames, through which an object is followed for a preview: 964 frames of 1080p."""


def matte(context: PreviewContext) -> Iterator[Record]:
    """A `mask` record for each wanted frame, at the size of the video: white = the objects. Frames before the first
    mark come after it, backwards."""
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

    marks = [ObjectMark(mark["frame"], mark["box"], mark["erase"]) for mark in context.options["marks"]]
    for done, (number, alpha) in enumerate(follow_marks(marks, (start, end), read), 1):
        plane = np.rint(255 * alpha).astype(np.uint8)
        header = {"type": "mask", "frame": number, "width": plane.shape[1], "height": plane.shape[0],
                  "media_type": "image/png"}  # fmt: skip
        yield Record(header, encode_gray_png(plane))
        yield Record({"type": "progress", "done": round(done / (end - start), 3), "note": "Following the object"})
