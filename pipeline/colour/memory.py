"""Temporal blending of flat colours: borders move smoothly from frame to frame, and flat areas stay flat.

The previous picture, moved along the flow, hides that the label map moves by whole pixels. It is limited to the range
of the colours nearby in this frame, as in temporal anti-aliasing: inside a region that range is one colour, so that
nothing of the past remains there, and beside a border only mixtures of the two colours do.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel


class BlendParams(NamedTuple):
    """Constants of the blending of colours."""

    reach_px: int = 2
    """Radius of the neighbourhood whose colours count as nearby."""
    slow_px: float = 5.0
    fast_px: float = 10.0
    """Speeds, px of the picture a frame, up to which the past has its full weight, and from which it has none: the
    error of the flow grows with speed, and would widen borders."""
    band_rows: int = 32
    """Rows that are blended at a time: their neighbourhoods stay in the processor's cache."""


BLEND = BlendParams()
NEARBY = np.ones((2 * BLEND.reach_px + 1, 2 * BLEND.reach_px + 1), np.uint8)


def blend_colours(
    now: Frame,
    past: Frame,
    residual: NDArray[np.uint8],
    flow: Flow | None,
    weights: NDArray[np.int32],
    background: FrameExecutor = INLINE,
) -> None:
    """Blend a picture with the previous one, in place of `past`.

    Args:
        now: uint8 (h, w, 3), the picture of this frame.
        past: uint8 (h, w, 3): the result for the previous frame, moved to this frame.
        residual: uint8, of the source, see `pipeline.perception.motion.denoise`; of the picture's size or smaller.
        flow: float32, of the size of `residual`, px of that size, previous to current frame; read at the target.
            None = the weight does not depend on speed.
        weights: int32 (256,): weight of the past by residual where nothing is fast, 256 = 1.
    """
    scale = len(now) / len(residual)
    by_place, by_residual = np.empty(residual.shape, np.uint8), (weights >> 1).astype(np.uint8)
    if flow is None:
        by_place = np.asarray(cv2.LUT(residual, by_residual), np.uint8)
    else:
        _weigh(residual, flow, by_residual, BLEND.slow_px / scale, BLEND.fast_px / scale, by_place)
    nearest = np.arange(len(now)) * len(residual) // len(now)

    def work(first: int, last: int) -> None:
        for top in range(first, last, BLEND.band_rows):
            rows = slice(top, min(top + BLEND.band_rows, last))
            around = slice(max(top - BLEND.reach_px, 0), rows.stop + BLEND.reach_px)
            inner = slice(top - around.start, rows.stop - around.start)
            low = np.asarray(cv2.erode(now[around], NEARBY), np.uint8)[inner]
            high = np.asarray(cv2.dilate(now[around], NEARBY), np.uint8)[inner]
            _blend(now[rows], low, high, past[rows], by_place, nearest[rows])

    background.rows(work, len(now))


@kernel
def _weigh(
    residual: NDArray[np.uint8], flow: Flow, by_residual: NDArray[np.uint8], slow: float, fast: float,
    out: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Write the weight of the past, 128 = 1."""
    height, width = residual.shape
    fall, end = np.float32(1 / (fast - slow)), np.float32(fast / (fast - slow))
    for y in range(height):
        pairs = flow[y].reshape(2 * width)
        for x in range(width):
            speed = np.sqrt(pairs[2 * x] * pairs[2 * x] + pairs[2 * x + 1] * pairs[2 * x + 1])
            share = min(max(end - speed * fall, np.float32(0)), np.float32(1))
            out[y, x] = np.uint8(np.float32(by_residual[residual[y, x]]) * share)


@kernel
def _blend(
    picture: Frame, low: Frame, high: Frame, past: Frame, weights: NDArray[np.uint8], nearest: NDArray[np.int64]
) -> None:
    """Blend the rows of a band; `nearest`: for each, its row in `weights`."""
    rows, width = picture.shape[0], picture.shape[1]
    weight = np.empty(3 * width, np.int16)
    columns = np.arange(width) * weights.shape[1] // width
    row = -1
    for y in range(rows):
        if nearest[y] != row:
            row = nearest[y]
            for x in range(width):
                weight[3 * x] = weight[3 * x + 1] = weight[3 * x + 2] = np.int16(weights[row, columns[x]])
        now, then = picture[y].reshape(3 * width), past[y].reshape(3 * width)
        least, most = low[y].reshape(3 * width), high[y].reshape(3 * width)
        for k in range(3 * width):  # this vectorises, in 16 bits
            near = min(max(np.int16(then[k]), np.int16(least[k])), np.int16(most[k]))
            change = np.int16(near - np.int16(now[k]))
            step = np.int16(np.int16(weight[k] * change) + np.int16(64)) >> np.int16(7)
            then[k] = np.uint8(np.int16(now[k]) + step)
