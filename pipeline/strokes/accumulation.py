"""Temporal accumulation: the mean of a painting and the previous paintings, advected along the motion.

The change of strokes between frames is partly motion, which advection follows, and partly random: streamlines bend
slightly, strokes end at another pixel, new strokes appear. The mean over a few frames reduces the random part. Where
nothing moves, all paintings are the same and no sharpness is lost.

Source: kagaya2011video, section 4.2, takes its advection from vanwijk2002image, whose pictures are blended over time
while they are advected. Departures: a few previous paintings are blended instead of all (an exponential mean would
make one long chain of dependent frames); advection follows the motion of the video; paintings are blended only where
they show the same surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Frame, Plane

SAME, OTHER = 39.0, 65.0
"""Change of the mean colour, gray levels, see `changes`: up to the first, pictures show the same surface; from the
second on, another one."""
SMALL, LARGE, WEIGHT = 0.02, 0.045, 2.2
"""Sides of the windows for mean colours, as fractions of the height: about a fine stroke, and a hand; factor on the
change in the larger window, which small misalignments of texture do not affect."""


@dataclass(frozen=True)
class Painting:
    """A painted frame with the data that aligns it to its neighbours.

    Attributes:
        paint: uint8 (h, w, 3), such as `emboss` returns.
        picture: uint8 (h', w', 3), the picture that was painted, possibly smaller.
        back: float32 (h', w', 2), flow from this frame to the one before, px of `picture`; None = a shot begins.
    """

    paint: Frame
    picture: Frame
    back: Flow | None


def accumulate(now: Painting, past: Sequence[Painting]) -> Frame:
    """Average a painting with the previous ones where they show the same surface: uint8 (h, w, 3).

    Args:
        past: paintings of the previous frames, latest first.
    """
    size = now.paint.shape[1], now.paint.shape[0]
    mean, weight = now.paint, np.ones(now.paint.shape[:2], np.float32)
    flow, step = None, now.back
    for before in past:
        if step is None:
            break
        flow = step if flow is None else np.asarray(flow + fetch(step, flow), np.float32)
        share = _enlarge(_similarity(now.picture, before.picture, flow), size)
        there = fetch(before.paint, _enlarge(flow, size) * np.float32(size[1] / flow.shape[0]))
        mean = np.asarray(cv2.blendLinear(mean, there, weight, share), np.uint8)
        weight = weight + share
        step = before.back
    return mean


def changes(now: NDArray[np.float32], before: NDArray[np.float32]) -> Plane:
    """Change of the mean colour around each pixel, maximum over the channels: float32 (h, w), gray levels.

    Args:
        now, before: float32 (h, w, 3); `before` is already aligned to `now`.
    """
    size = (now.shape[1], now.shape[0])
    half = (max(1, size[0] // 2), max(1, size[1] // 2))
    difference = np.asarray(cv2.resize(now - before, half, interpolation=cv2.INTER_AREA), np.float32)
    small, large = (_mean_change(difference, max(3, round(part * half[1])) | 1) for part in (SMALL, LARGE))
    return _enlarge(np.asarray(cv2.max(small, large * np.float32(WEIGHT)), np.float32), size)


def _mean_change(difference: NDArray[np.float32], side: int) -> Plane:
    red, green, blue = (np.abs(cv2.boxFilter(plane, -1, (side, side))) for plane in cv2.split(difference))
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.float32)


def _similarity(picture: Frame, before: Frame, flow: Flow) -> Plane:
    """Weight 0..1 by which a pixel shows the same surface as the earlier picture at p + flow: float32 (h, w)."""
    change = changes(picture.astype(np.float32), np.asarray(fetch(before, flow), np.float32))
    height, width = change.shape
    x = flow[..., 0] + np.arange(width, dtype=np.float32)
    y = flow[..., 1] + np.arange(height, dtype=np.float32)[:, None]
    inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    return np.asarray(np.clip((np.float32(OTHER) - change) / np.float32(OTHER - SAME), 0, 1) * inside, np.float32)


def _enlarge(plane: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    if (plane.shape[1], plane.shape[0]) == size:
        return plane
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), np.float32)
