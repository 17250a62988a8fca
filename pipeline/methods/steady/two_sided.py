"""The second pass, backwards in time, which averages each result with those of later frames (bonneel2015blind,
section 4). Live streams have no later frames, so only jobs have this pass.

A window has three times as many frames as a result depends on ahead. From the last frame of a window to its first,

    y_t  =  x_t  +  SHARE c mask (y_t+1 moved along the motion  -  x_t)

where x is the result of the first pass, forwards in time, and c the confidence in the motion from frame t to t + 1. The
first two thirds of the window are then complete, and the next window begins with the last third.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.steady.confidence import Picture, TrustedMotion

SHARE = np.float32(0.8)
"""Weight of the next result in a result where the motion is certain. The result k frames ahead has SHARE^k."""


@dataclass(frozen=True)
class FilteredFrame:
    """A frame after the first pass, forwards in time."""

    index: int
    result: Frame
    mask: Plane | None
    """1 = steady, 0 = as it is, float32 (h, w); None = 1 everywhere."""
    from_previous: TrustedMotion | None
    """Motion from the previous frame to this one; None at the first frame of a shot, and without `look_ahead`."""


def average_backwards(frames: Iterator[FilteredFrame], ahead: int) -> Iterator[tuple[int, Frame]]:
    """Average frames with later ones; yields (frame number, uint8 (h, w, 3)) in order.

    Args:
        frames: consecutive frames of one shot.
        ahead: minimum number of later frames on which a result depends, if the shot has so many; >= 1.
    """
    window: list[FilteredFrame] = []
    for frame in frames:
        window.append(frame)
        if len(window) == 3 * ahead:
            yield from _averaged(window)[: 2 * ahead]
            del window[: 2 * ahead]
    yield from _averaged(window)


def _averaged(window: list[FilteredFrame]) -> list[tuple[int, Frame]]:
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
        later, onward = now, frame.from_previous
        made.append((frame.index, np.asarray(np.rint(now.clip(0, 255)), np.uint8)))
    return made[::-1]
