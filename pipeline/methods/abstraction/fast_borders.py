"""Steep borders where something moves fast.

Blending with the past (`pipeline.colour.memory`) hides that a border moves in small jumps, but widens it by the error
of the flow, which grows with speed: to 3 to 5 px at 20 px a frame. There, the blended picture is mixed with its
steepened version (`pipeline.strokes.steepen`). Slow borders stay as they are: they are narrow, and would flicker.

Departure: this is not part of zhang2011online, which does not blend with the past.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour.memory import BLEND
from pipeline.frames import Frame
from pipeline.kernels.jit import kernel
from pipeline.perception.backward_maps import BLOCK_PX, block_spans, scaled_span
from pipeline.strokes.steepen import steepen


@dataclass(frozen=True)
class SteepParams:
    """Constants of steep borders."""

    slow_px: float = 5.0
    fast_px: float = 10.0
    """Speeds, px of the picture a frame, up to which borders are not steepened, and from which they are steepened
    most."""
    most: float = 0.7
    """Largest share of the steepened picture."""
    steps: int = 2
    """Steps of steepening, see `steepen`."""
    reach_px: int = 4
    """Distance from a border that is steepened, px of the picture."""
    margin_px: int = steps + 2
    """Distance, px, of the pixels that `steepen` reads."""


STEEP = SteepParams()


def steepen_fast_borders(picture: Frame, speeds: NDArray[np.uint8]) -> None:
    """Make borders steeper where they move fast, in place of `picture`.

    Args:
        picture: uint8 (h, w, 3), RGB, blended with the past.
        speeds: uint8 (rows, columns), of the picture's size or smaller, from `moving_borders`.
    """
    height, width = picture.shape[:2]
    down, across = height / speeds.shape[0], width / speeds.shape[1]
    shares = _share_of_speed(down)
    if not shares[int(speeds.max())]:
        return
    reach = math.ceil(STEEP.reach_px / down)
    fastest_near = np.asarray(cv2.dilate(speeds, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)), np.uint8)
    share = np.asarray(cv2.LUT(fastest_near, shares), np.uint8)
    parts = []
    for rows, columns in block_spans(_used_blocks(share), (share.shape[1], share.shape[0])):
        near = share[rows, columns]
        rows, columns = scaled_span(rows, down), scaled_span(columns, across)
        top, left = max(rows.start - STEEP.margin_px, 0), max(columns.start - STEEP.margin_px, 0)
        steep = steepen(picture[top : rows.stop + STEEP.margin_px, left : columns.stop + STEEP.margin_px], STEEP.steps)
        size = columns.stop - columns.start, rows.stop - rows.start
        enlarged = np.asarray(cv2.resize(near, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        parts.append((steep, enlarged, (rows.start, columns.start), (rows.start - top, columns.start - left)))
    for part in parts:  # only now: the margin of a part belongs to other parts
        _mix(picture, *part)


def _share_of_speed(scale: float) -> NDArray[np.uint8]:
    """Share of the steepened picture in 1/256 by speed, uint8 (256,). `scale`: px of the picture per px of the flow."""
    speeds_px = np.arange(256) / BLEND.speed_steps * scale
    return np.rint(
        256 * STEEP.most * np.clip((speeds_px - STEEP.slow_px) / (STEEP.fast_px - STEEP.slow_px), 0, 1)
    ).astype(np.uint8)


@kernel
def _used_blocks(share: NDArray[np.uint8]) -> NDArray[np.int8]:
    """1 for each block of `BLOCK_PX` in which `share` is not 0 everywhere, else 0: int8 (rows, columns)."""
    height, width = share.shape
    blocks = np.zeros((-(-height // BLOCK_PX), -(-width // BLOCK_PX)), np.int8)
    for y in range(height):
        for column in range(blocks.shape[1]):
            most = np.uint8(0)
            for x in range(column * BLOCK_PX, min((column + 1) * BLOCK_PX, width)):  # this vectorises
                most = max(most, share[y, x])
            if most:
                blocks[y // BLOCK_PX, column] = 1
    return blocks


@kernel
def _mix(
    picture: Frame, steep: Frame, share: NDArray[np.uint8], corner: tuple[int, int], margin: tuple[int, int]
) -> None:
    """Mix a part of the picture with its steepened version, in place.

    Args:
        share: of `steep`, in 1/256; its size is that of the part.
        corner, margin: row and column of the part's first pixel in `picture` and in `steep`.
    """
    height, width = share.shape
    by_byte = np.empty(3 * width, np.int16)
    for y in range(height):
        for x in range(width):
            by_byte[3 * x] = by_byte[3 * x + 1] = by_byte[3 * x + 2] = np.int16(share[y, x] >> 1)
        before = picture[corner[0] + y].reshape(3 * picture.shape[1])[3 * corner[1] : 3 * (corner[1] + width)]
        after = steep[margin[0] + y].reshape(3 * steep.shape[1])[3 * margin[1] : 3 * (margin[1] + width)]
        for k in range(3 * width):  # this vectorises, in 16 bits
            change = np.int16(np.int16(after[k]) - np.int16(before[k]))
            step = np.int16(np.int16(by_byte[k] * change) + np.int16(64)) >> np.int16(7)
            before[k] = np.uint8(np.int16(before[k]) + step)
