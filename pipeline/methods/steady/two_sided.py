"""The second pass, backwards in time: each result is also averaged with the results that follow it (bonneel2015blind,
section 4). It needs later frames, so only jobs have it, not live streams.

Frames are taken in windows of three times the frames to look ahead. In a window, from its last frame to its first,

    y_t  =  x_t  +  SHARE c mask (y_t+1 moved along the motion  -  x_t)

with the result x of the pass forwards and the confidence c in the motion from frame t to t + 1. The frames of the first
two thirds are then complete; the next window begins with the last third.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.steady.confidence import Picture, TrustedMotion

SHARE = np.float32(0.8)
"""Share of the next result in a result where the motion is certain. Results farther ahead count as its powers."""


@dataclass(frozen=True)
class Steadied:
    """A frame after the pass forwards."""

    index: int
    result: Frame
    mask: Plane | None
    """1 = steady, 0 = as it is, float32 (h, w); None = 1 everywhere."""
    from_last: TrustedMotion | None
    """Motion from the last frame to this one; None at the first frame of a shot, and where it is not needed."""


def average_backwards(frames: Iterator[Steadied], ahead: int) -> Iterator[tuple[int, Frame]]:
    """Indices and averaged frames, in order.

    Args:
        frames: consecutive frames of one shot.
        ahead: number of later frames on which a result depends at least, where the shot has them; >= 1.
    """
    window: list[Steadied] = []
    for frame in frames:
        window.append(frame)
        if len(window) == 3 * ahead:
            yield from _averaged(window)[: 2 * ahead]
            del window[: 2 * ahead]
    yield from _averaged(window)


def _averaged(window: list[Steadied]) -> list[tuple[int, Frame]]:
    """All frames of a window, averaged with those that follow in it."""
    made: list[tuple[int, Frame]] = []
    later: Picture | None = None
    onward: TrustedMotion | None = None
    for frame in reversed(window):
        now: Picture = frame.result.astype(np.float32)
        if later is not None and onward is not None:
            moved = cv2.remap(later, *onward.to, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            share = onward.trust * SHARE
            share = share if frame.mask is None else share * frame.mask
            now += share[..., None] * (moved - now)
        later, onward = now, frame.from_last
        made.append((frame.index, np.asarray(np.rint(now.clip(0, 255)), np.uint8)))
    return made[::-1]
