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

from pipeline.arrays import AnyArray
from pipeline.frames import Plane
from pipeline.methods.steady.confidence import Picture, TrustedMotion

SHARE = np.float32(0.8)
"""Weight of the next result in a result where the motion is certain. The result k frames ahead has SHARE^k."""
WINDOW, COMPLETE = 3, 2
"""Frames of a window, and those of them that are complete, as multiples of the frames ahead."""


@dataclass(frozen=True)
class FilteredFrame:
    """A frame after the first pass, forwards in time."""

    index: int
    result: AnyArray
    """uint8, or float32 with white at 1."""
    mask: Plane | None
    """1 = steady, 0 = as it is, float32 (h, w); None = 1 everywhere."""
    from_previous: TrustedMotion | None
    """Motion from the previous frame to this one; None at the first frame of a shot, and without `look_ahead`."""


def average_backwards(frames: Iterator[FilteredFrame], ahead: int) -> Iterator[tuple[int, AnyArray]]:
    """Average frames with later ones; yields (frame number, frame (h, w, 3) of the type of the results) in order.

    Args:
        frames: consecutive frames of one shot.
        ahead: minimum number of later frames on which a result depends, if the shot has so many; >= 1.
    """
    window: list[FilteredFrame] = []
    for frame in frames:
        window.append(frame)
        if len(window) == WINDOW * ahead:
            yield from _averaged(window)[: COMPLETE * ahead]
            del window[: COMPLETE * ahead]
    yield from _averaged(window)


def _averaged(window: list[FilteredFrame]) -> list[tuple[int, AnyArray]]:
    """All frames of a window, averaged with those that follow in it."""
    made: list[tuple[int, AnyArray]] = []
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
        deep = frame.result.dtype == np.float32
        made.append((frame.index, now if deep else np.asarray(np.rint(now.clip(0, 255)), np.uint8)))
    return made[::-1]
