"""Finds the hard cuts of a video as a job does: at full resolution, and with the sensitivity of the layer."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.frames import Plane
from pipeline.methods import method, parse_params
from pipeline.perception.cuts import is_cut, thumbnail
from workers.previews.context import PreviewContext
from workers.previews.model import LayerSources, Record

PIECE = 24
"""Frames between two records of progress."""
_KEPT_BYTES = 200


def cuts(context: PreviewContext) -> Iterator[Record]:
    """First frames of all shots but the first: those found so far with each record of progress, then all of them."""
    layer = context.query.layers[0]
    sensitivity = _sensitivity(layer)
    name = ("cuts", layer.video, sensitivity)
    found: list[int] | None = context.cache.peek(name)
    if found is None:
        total, found = context.frames.info(layer.video).frames, []
        before: Plane | None = None
        for index, frame in enumerate(context.frames.stream(layer.video, 0, total)):
            context.check()
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, sensitivity):
                found.append(index)
            before = now
            if index % PIECE == PIECE - 1:
                done = round((index + 1) / max(total, index + 1), 3)
                yield Record({"type": "progress", "done": done, "note": "Finding cuts", "cuts": list(found)})
        context.cache.put(name, found, _KEPT_BYTES)
    yield Record({"type": "cuts", "cuts": found})


def _sensitivity(layer: LayerSources) -> float:
    """The layer's parameter for it; 1 for a method without one."""
    chosen = method(layer.method)
    return float(getattr(parse_params(chosen, layer.params), chosen.studio.cuts, 1.0))
