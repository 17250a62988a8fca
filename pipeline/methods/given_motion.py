"""Motion between the frames of a job's video: that of its motion vectors, where it has any; otherwise methods estimate
it."""

from __future__ import annotations

from typing import Any

from pipeline.frames import Flow
from pipeline.methods.base import TaskContext
from pipeline.passes.sequence import PassSequence, pass_sequence
from pipeline.video.guard.pictures import guarded_planes, guarded_raw


class GivenMotion:
    """The motion that renderers wrote beside the pictures. Safe for several threads.

    Args:
        passes: those of the video; None: it has none.
    """

    def __init__(self, passes: PassSequence | None = None) -> None:
        self._passes = passes

    def flow(self, first: int, second: int, size: tuple[int, int]) -> Flow | None:
        """Flow from a frame to its neighbour, see `PassSequence.flow`: numbers of the film, float32 (height, width, 2),
        px at `size` (width, height); None: it has to be estimated."""
        if self._passes is None or min(first, second) < 0 or max(first, second) >= len(self._passes):
            return None
        return self._passes.flow(first, second, size)


NO_MOTION = GivenMotion()
"""Every flow has to be estimated."""


def given_motion(context: TaskContext[Any]) -> GivenMotion:
    """The motion vectors of the job's video. Raises: UnreadableMedia: the layout of a shot is wrong."""
    return GivenMotion(pass_sequence(context.passes(), guarded_planes, guarded_raw, context.pass_facts))
