"""Temporal blending of flat colours: what changes fades over instead of popping, and borders stay sharp."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.background import INLINE, Background
from pipeline.frames import Flow, Frame, Labels
from pipeline.jit import kernel

MOVING_SHARE = 180
"""Weight of the past at borders that move, over that elsewhere, in 1/256."""
NEIGHBOURS, NEARBY = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)


def border_mask(labels: Labels) -> NDArray[np.uint8]:
    """uint8 (h, w), 255 on and next to region borders, 0 elsewhere."""
    mask = np.empty(labels.shape, np.uint8)
    _borders(labels, mask)
    return np.asarray(cv2.dilate(mask, NEIGHBOURS), np.uint8)


def blend_colours(
    now: Frame, past: Frame, weights: NDArray[np.uint8], moving: NDArray[np.uint8], background: Background = INLINE
) -> None:
    """Blend a picture of flat regions with the previous one; overwrites `past` with the result.

    At borders that move, a past colour between the colours nearby is a border that has moved on: it has a smaller
    weight there, since every warp blurs a border a little. The part beyond their range is a region that has gone: it
    fades like elsewhere.

    Args:
        now: uint8 (h, w, 3), the regions of this frame.
        past: uint8 (h, w, 3): the result for the previous frame, moved to this frame.
        weights: uint8 (h, w): weight of the past, 255 = 1.
        moving: uint8 (h, w), non-zero at borders that move.
    """
    low = np.asarray(cv2.erode(now, NEARBY), np.uint8)
    high = np.asarray(cv2.dilate(now, NEARBY), np.uint8)

    def work(first: int, last: int) -> None:
        rows = slice(first, last)
        _blend(now[rows], low[rows], high[rows], past[rows], weights[rows], moving[rows])

    background.rows(work, len(now))


def moving_borders(labels: Labels, flow: Flow) -> NDArray[np.uint8]:
    """uint8 (h, w), non-zero on and next to region borders where the flow is not 0."""
    mask = border_mask(labels)
    _keep_moving(mask, flow)
    return mask


@kernel
def _keep_moving(mask: NDArray[np.uint8], flow: Flow) -> None:
    height, width = mask.shape
    for y in range(height):
        for x in range(width):
            mask[y, x] *= np.uint8((flow[y, x, 0] != 0.0) | (flow[y, x, 1] != 0.0))


@kernel
def _borders(labels: Labels, out: NDArray[np.uint8]) -> None:
    height, width = labels.shape
    for y in range(height):
        row, below = labels[y], labels[min(y + 1, height - 1)]
        for x in range(width - 1):  # this vectorises
            out[y, x] = np.uint8(255) * np.uint8((row[x] != row[x + 1]) | (row[x] != below[x]))
        out[y, width - 1] = np.uint8(255) * np.uint8(row[width - 1] != below[width - 1])


@kernel
def _blend(
    picture: Frame, low: Frame, high: Frame, past: Frame, weights: NDArray[np.uint8], moving: NDArray[np.uint8]
) -> None:
    height, width = weights.shape
    for y in range(height):
        for x in range(width):
            weight, mixed = np.int32(weights[y, x]), moving[y, x] != 0
            for c in range(3):
                now, before = np.int32(picture[y, x, c]), np.int32(past[y, x, c])
                gone = before - now
                if mixed:
                    near = min(max(before, np.int32(low[y, x, c])), np.int32(high[y, x, c]))
                    gone = before - near + (((near - now) * MOVING_SHARE) >> 8)
                step = (weight * gone + 127) // 255
                past[y, x, c] = np.uint8(min(max(now + step, np.int32(0)), np.int32(255)))
