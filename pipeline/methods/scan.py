"""Scan of a video, the first step of a plan: number of decodable frames, and first frames of the shots."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from pipeline.errors import BadInput
from pipeline.frames import Frame, Plane
from pipeline.methods.base import AnyParams, TaskContext
from pipeline.perception.cuts import is_cut, thumbnail

_PROGRESS_FRAMES = 16


def scan_video(
    context: TaskContext[AnyParams], cut_sensitivity: float, each: Callable[[Frame], None] | None = None
) -> tuple[int, list[int]]:
    """Decode the whole video once.

    Cuts are found from pairs of neighbouring thumbnails, exactly as a live session finds them.

    Args:
        cut_sensitivity: as for `pipeline.perception.cuts.is_cut`; 0 finds no cuts.
        each: called with every frame, within the clock "scan".

    Returns:
        Number of frames; indices of the first frames of all shots but the first, ascending.

    Raises:
        BadInput: the video has no frames.
    """
    before: Plane | None = None
    cuts: list[int] = []
    count = 0
    for index, now in enumerate(context.thumbnails() if each is None else _seen(context, each)):
        with context.clock("scan"):
            if before is not None and is_cut(before, now, cut_sensitivity):
                cuts.append(index)
        before, count = now, index + 1
        if index % _PROGRESS_FRAMES == 0:
            context.progress(min(1.0, count / max(context.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return count, cuts


def _seen(context: TaskContext[AnyParams], each: Callable[[Frame], None]) -> Iterator[Plane]:
    """Thumbnails of all frames, which `each` is called with."""
    for frame in context.frames("video"):
        with context.clock("scan"):
            each(frame)
            made = thumbnail(frame)
        yield made
