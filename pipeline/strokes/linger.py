"""Paint that lingers: a painting is averaged with those of the frames before, carried to where things are now.

What strokes do from frame to frame is half motion, which is carried along, and half chance: a streamline bends a little
otherwise, a stroke is cut at another pixel, another one comes up. Over a few frames chance averages out. It costs no
sharpness where nothing moves, since there all the paintings are the same.

Source: kagaya2011video, section 4.2, takes its advection from vanwijk2002image, whose pictures are blended over time as
they are carried. Departure: it blends the last few paintings, not all (an average that forgets slowly would make frame
after frame one long chain); along the picture's motion; and only where they show the same thing.
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
"""Pictures that have changed by less show the same thing, by more another one: see `changes`."""
SMALL, LARGE, WEIGHT = 0.02, 0.045, 2.2
"""Sides, in heights, of the squares that mean colours are compared over: about a fine stroke, and a hand. What differs
in the larger one counts more, since textures that are not quite where the motion says do not."""


@dataclass(frozen=True)
class Layout:
    """A painting, and what tells where it belongs.

    Attributes:
        paint: uint8 (h, w, 3), such as `emboss` gives.
        picture: uint8 (h', w', 3), what it was painted from, perhaps smaller.
        back: float32 (h', w', 2), from this frame to the one before, px of `picture`; None = nothing was before.
    """

    paint: Frame
    picture: Frame
    back: Flow | None


def linger(now: Layout, past: Sequence[Layout]) -> Frame:
    """The mean of a painting and of those before it, uint8 (h, w, 3): each where it shows the same thing.

    Args:
        past: of the frames before, the latest first.
    """
    size = now.paint.shape[1], now.paint.shape[0]
    mean, weight = now.paint, np.ones(now.paint.shape[:2], np.float32)
    way, step = None, now.back
    for before in past:
        if step is None:
            break
        way = step if way is None else np.asarray(way + fetch(step, way), np.float32)
        share = _wider(_alike(now.picture, before.picture, way), size)
        there = fetch(before.paint, _wider(way, size) * np.float32(size[1] / way.shape[0]))
        mean = np.asarray(cv2.blendLinear(mean, there, weight, share), np.uint8)
        weight = weight + share
        step = before.back
    return mean


def changes(now: NDArray[np.float32], before: NDArray[np.float32]) -> Plane:
    """How much the mean colour about each pixel has changed, in the channel where it has most: float32 (h, w), levels.

    Args:
        now, before: float32 (h, w, 3), the latter already carried to where things are now.
    """
    size = (now.shape[1], now.shape[0])
    half = (max(1, size[0] // 2), max(1, size[1] // 2))
    apart = np.asarray(cv2.resize(now - before, half, interpolation=cv2.INTER_AREA), np.float32)
    small, large = (_mean_change(apart, max(3, round(part * half[1])) | 1) for part in (SMALL, LARGE))
    return _wider(np.asarray(cv2.max(small, large * np.float32(WEIGHT)), np.float32), size)


def _mean_change(apart: NDArray[np.float32], side: int) -> Plane:
    red, green, blue = (np.abs(cv2.boxFilter(plane, -1, (side, side))) for plane in cv2.split(apart))
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.float32)


def _alike(picture: Frame, before: Frame, way: Flow) -> Plane:
    """How far the picture shows what the one before shows where the way leads, 0..1, float32 (h, w)."""
    apart = changes(picture.astype(np.float32), np.asarray(fetch(before, way), np.float32))
    height, width = apart.shape
    x = way[..., 0] + np.arange(width, dtype=np.float32)
    y = way[..., 1] + np.arange(height, dtype=np.float32)[:, None]
    inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    return np.asarray(np.clip((np.float32(OTHER) - apart) / np.float32(OTHER - SAME), 0, 1) * inside, np.float32)


def _wider(plane: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    if (plane.shape[1], plane.shape[0]) == size:
        return plane
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), np.float32)
