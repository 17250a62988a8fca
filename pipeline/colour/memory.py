"""Temporal blending of flat colours: colour changes fade in, and borders stay sharp."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions


class BlendParams(NamedTuple):
    """Constants of the blending of colours."""

    moving_share: int = 115
    """Weight of the past at moving borders relative to that elsewhere, in 1/128."""
    speed_steps: int = 8
    """Steps of a border's speed per px a frame."""
    reach_px: int = 2
    """Radius of the neighbourhood whose colours count as nearby."""
    band_rows: int = 32
    """Rows that are blended at a time: their neighbourhoods stay in the processor's cache."""


BLEND = BlendParams()


NEIGHBOURS, NEARBY = np.ones((3, 3), np.uint8), np.ones((2 * BLEND.reach_px + 1, 2 * BLEND.reach_px + 1), np.uint8)


def border_mask(labels: Labels) -> NDArray[np.uint8]:
    """Mask of region borders: uint8 (h, w), 255 on and next to borders, 0 elsewhere."""
    mask = np.empty(labels.shape, np.uint8)
    _borders(labels, mask)
    return np.asarray(cv2.dilate(mask, NEIGHBOURS), np.uint8)


def blend_colours(
    now: Frame, past: Frame, residual: NDArray[np.uint8], weights: NDArray[np.int32], moving: NDArray[np.uint8],
    background: FrameExecutor = INLINE,
) -> None:  # fmt: skip
    """Blend a picture of flat regions with the previous one, in place of `past`.

    At a moving border, a past colour within the range of the colours nearby belongs to the border's earlier position.
    It has a smaller weight, since repeated warping blurs borders. The part of a past colour beyond that range belongs
    to a region that has vanished, and fades with the full weight.

    Args:
        now: uint8 (h, w, 3), the regions of this frame.
        past: uint8 (h, w, 3): the result for the previous frame, moved to this frame.
        residual: uint8, of the source; of the picture's size or smaller.
        weights: int32 (256,): weight of the past by residual, 256 = 1.
        moving: uint8, of the size of `residual`, non-zero at borders that move.
    """
    nearest = np.arange(len(now)) * len(moving) // len(now)

    def work(first: int, last: int) -> None:
        for top in range(first, last, BLEND.band_rows):
            rows = slice(top, min(top + BLEND.band_rows, last))
            low = high = now[rows]
            beside = moving[nearest[top] : nearest[rows.stop - 1] + 1]
            if beside.any():  # the range of the colours nearby counts at moving borders only
                around = slice(max(top - BLEND.reach_px, 0), rows.stop + BLEND.reach_px)
                inner = slice(top - around.start, rows.stop - around.start)
                low = np.asarray(cv2.erode(now[around], NEARBY), np.uint8)[inner]
                high = np.asarray(cv2.dilate(now[around], NEARBY), np.uint8)[inner]
            _blend(now[rows], low, high, past[rows], residual, weights, moving, nearest[rows])

    background.rows(work, len(now))


def moving_borders(labels: Labels, flow: Flow) -> NDArray[np.uint8]:
    """Speed of region borders, uint8 (h, w), px a frame times `BLEND.speed_steps`: 1..255 on and next to borders where
    the flow, float32 (h, w, 2), px, is not 0; 0 elsewhere."""
    speeds = border_mask(labels)
    _measure_speeds(flow, speeds)
    return speeds


@kernel
def _measure_speeds(flow: Flow, speeds: NDArray[np.uint8]) -> None:
    """Replace all values that are not 0."""
    height, width = speeds.shape
    places = np.empty(width, np.int32)
    for y in range(height):
        for x in places[: nonzero_positions(speeds[y], places)]:
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            square = dx * dx + dy * dy
            if square > 0:
                speed = np.float32(BLEND.speed_steps) * np.sqrt(square)
                speeds[y, x] = np.uint8(min(max(speed, np.float32(1)), np.float32(255)))
            else:
                speeds[y, x] = 0


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
    picture: Frame, low: Frame, high: Frame, past: Frame, residual: NDArray[np.uint8], weights: NDArray[np.int32],
    moving: NDArray[np.uint8], nearest: NDArray[np.int64],
) -> None:  # fmt: skip
    """Blend the rows of a band; `nearest`: for each, its row in `residual` and `moving`."""
    rows, width = picture.shape[0], picture.shape[1]
    weight, share = np.empty(3 * width, np.int16), np.empty(3 * width, np.int16)
    columns = np.arange(width) * residual.shape[1] // width
    row = -1
    for y in range(rows):
        if nearest[y] != row:
            row = nearest[y]
            for x in range(width):
                at, x_there = 3 * x, columns[x]
                weight[at] = weight[at + 1] = weight[at + 2] = np.int16(weights[residual[row, x_there]] >> 1)
                share[at] = share[at + 1] = share[at + 2] = np.int16(
                    BLEND.moving_share if moving[row, x_there] else 128
                )
        now, then = picture[y].reshape(3 * width), past[y].reshape(3 * width)
        least, most = low[y].reshape(3 * width), high[y].reshape(3 * width)
        for k in range(3 * width):  # this vectorises, in 16 bits
            before = np.int16(then[k])
            near = min(max(before, np.int16(least[k])), np.int16(most[k]))
            part = np.int16(np.int16(near - np.int16(now[k])) * share[k]) >> np.int16(7)
            change = np.int16(np.int16(before - near) + np.int16(part))
            step = np.int16(np.int16(weight[k] * change) + np.int16(64)) >> np.int16(7)
            then[k] = np.uint8(np.int16(now[k]) + step)
