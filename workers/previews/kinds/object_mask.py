"""The object of a frame that a user has clicked, or drawn a box around."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.perception.object_mask import object_mask
from pipeline.video.stills import encode_gray_png
from workers.previews.context import PreviewContext
from workers.previews.model import Record


def marked_object(context: PreviewContext) -> Iterator[Record]:
    """A `mask` record: white = the object."""
    number, side = context.options["frame"], context.query.side_px
    frame = context.frames.frame(context.query.layers[0].video, number, side)
    plane = np.where(object_mask(frame, context.options["box"]), 255, 0).astype(np.uint8)
    header = {"type": "mask", "frame": number, "width": plane.shape[1], "height": plane.shape[0],
              "media_type": "image/png"}  # fmt: skip
    yield Record(header, encode_gray_png(plane))
