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

from pipeline.buffers import Buffers
from pipeline.flow.warp import positions
from pipeline.frames import Frame, Plane
from pipeline.methods.steady.confidence import Evidence, Picture, confidence, motion
from pipeline.methods.steady.filter import SourceAnalysis

SHARE = np.float32(0.8)
"""Share of the next result in a result where the motion is certain. Results farther ahead count as its powers."""


@dataclass
class Steadied:
    """A frame after the pass forwards."""

    index: int
    source: Frame
    result: Frame
    mask: Plane | None
    """1 = steady, 0 = as it is, float32 (h, w); None = 1 everywhere."""
    onward: SourceAnalysis | None = None
    """Motion to the next frame, once it is known."""


def average_backwards(frames: Iterator[Steadied], ahead: int, alpha: float) -> Iterator[tuple[int, Frame]]:
    """Indices and averaged frames, in order.

    Args:
        frames: consecutive frames of one shot.
        ahead: number of later frames on which a result depends at least, where the shot has them; >= 1.
        alpha: rate at which the confidence falls with the colour difference, see `confidence`.
    """
    window: list[Steadied] = []
    for frame in frames:
        window.append(frame)
        if len(window) == 3 * ahead:
            yield from _averaged(window, alpha)[: 2 * ahead]
            del window[: 2 * ahead]
    yield from _averaged(window, alpha)


def _averaged(window: list[Steadied], alpha: float) -> list[tuple[int, Frame]]:
    """All frames of a window, averaged with those that follow in it."""
    buffers, made = Buffers(), list[tuple[int, Frame]]()
    later: Picture | None = None
    for frame, after in zip(reversed(window), (None, *reversed(window)), strict=False):
        now: Picture = frame.result.astype(np.float32)
        if later is not None and after is not None:
            frame.onward = frame.onward or _onward(frame.source, after.source, alpha, buffers)
            moved = cv2.remap(later, *frame.onward.back, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            share = frame.onward.trust * SHARE
            share = share if frame.mask is None else share * frame.mask
            now += share[..., None] * (moved - now)
        later = now
        made.append((frame.index, np.asarray(np.rint(now.clip(0, 255)), np.uint8)))
    return made[::-1]


def _onward(source: Frame, after: Frame, alpha: float, buffers: Buffers) -> SourceAnalysis:
    """Motion from `source` to the frame after it, and the confidence in it."""
    onward, back = motion(after, source)
    there = positions(onward)
    round_trip = cv2.remap(back, *there, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    warped = np.asarray(cv2.remap(after, *there, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)
    evidence = Evidence(onward, np.asarray(round_trip, np.float32), source, warped, warped.astype(np.float32))
    return SourceAnalysis(there, confidence(evidence, alpha, buffers))
