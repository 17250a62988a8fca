"""Scan of a video, the first step of a plan: number of decodable frames, and first frames of the shots."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

from pipeline.errors import BadInput
from pipeline.frames import Frame, Plane
from pipeline.methods.base import AnyParams, PlanContext, TaskContext, TaskResult
from pipeline.perception.cuts import is_cut, thumbnail

_PROGRESS_FRAMES = 16


def scan_video(
    context: TaskContext[AnyParams], cut_sensitivity: float, each: Callable[[Frame], None] | None = None,
    span: tuple[int | None, int | None] = (None, None),
) -> tuple[int, list[int]]:  # fmt: skip
    """Decode the frames to paint once.

    Cuts are found from pairs of neighbouring thumbnails, exactly as a live session finds them.

    Args:
        cut_sensitivity: as for `pipeline.perception.cuts.is_cut`; 0 finds no cuts.
        each: called with every frame, within the clock "scan".
        span: other frames [first, end) of the film to decode; None: those to paint.

    Returns:
        Number of the frame after the last; numbers of the first frames of all shots but the first, ascending.

    Raises:
        BadInput: the video has no frames.
    """
    before: Plane | None = None
    cuts: list[int] = []
    count = first = context.video.first if span[0] is None else span[0]
    end = max(context.video.stop if span[1] is None else span[1], first + 1)
    pictures = context.thumbnails("video", *span) if each is None else _seen(context, each, span)
    for index, now in enumerate(pictures, first):
        with context.clock("scan"):
            if before is not None and is_cut(before, now, cut_sensitivity):
                cuts.append(index)
        before, count = now, index + 1
        if index % _PROGRESS_FRAMES == 0:
            context.progress(min(1.0, (count - first) / (max(end, count) - first)))
    if count == first:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return count, cuts


def shots_of(context: PlanContext[AnyParams], scan: TaskResult) -> Iterator[tuple[int, int]]:
    """First frame of every shot, and the frame after its last.

    Args:
        scan: a result with "frames" and "cuts" of `scan_video`, and "first", if it began at another frame than the
            first one to paint.
    """
    return pairwise([scan.get("first", context.video.first), *scan["cuts"], scan["frames"]])


def delivered_shots(context: PlanContext[AnyParams], scan: TaskResult) -> Iterator[tuple[int, int]]:
    """The shots of which a frame is part of the result."""
    return (shot for shot in shots_of(context, scan) if context.video.delivers_any(*shot))


def _seen(
    context: TaskContext[AnyParams], each: Callable[[Frame], None], span: tuple[int | None, int | None]
) -> Iterator[Plane]:
    """Thumbnails of the frames, which `each` is called with."""
    for frame in context.frames("video", *span):
        with context.clock("scan"):
            each(frame)
            made = thumbnail(frame)
        yield made
