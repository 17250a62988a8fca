"""Restoration of the texture that averaging along the motion has blurred."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.jit import kernel
from pipeline.methods.steady.confidence import Picture

SIGMA_PX = 0.7
"""Standard deviation of the Gaussian blur whose complement is texture."""
CELL_PX = 4
"""Amounts of texture are summed in cells of this side first."""
WINDOW_CELLS = 5
"""Side of the window, in cells, over which the amounts are averaged."""
MEMORY = np.float32(0.9)
"""Share of the last frame's amounts in those of a frame. The amount in a single frame flickers as its texture does, and
the amplified texture would flicker with it."""
LARGEST = 3.0
"""Largest amplification: faint texture does not become noise."""

Amounts = NDArray[np.float32]
"""Mean texture around each cell, float32 (3, rows, columns): of the result, of the styled frame, and the increase of
the result's when its texture is added to it once. Without rows before the second frame of a shot."""
NO_AMOUNTS: Amounts = np.empty((3, 0, 0), np.float32)


def restore_detail(picture: Picture, styled: Picture, share: float, before: Amounts) -> tuple[Picture, Amounts]:
    """`picture` with its texture amplified (or damped) to the amount that the styled frames have around each pixel.

    An average of n frames with independent texture keeps 1/sqrt(n) of its contrast. Amplification restores the
    contrast; the texture stays that of the average, which changes slowly.

    Args:
        picture, styled: float32 (h, w, 3), 0..255.
        share: of the missing texture that is restored, 0..1.
        before: amounts at the last frame.

    Returns:
        float32 (h, w, 3), which may exceed 0..255 a little, and the amounts at this frame.
    """
    coarse = _blurred(picture)
    fine: Picture = picture - coarse
    amounts = np.stack([_amount(each, low) for each, low in (
        (picture, coarse), (styled, _blurred(styled)), (fine, _blurred(fine)),
    )])  # fmt: skip
    if before.size:
        amounts = MEMORY * before + (1 - MEMORY) * amounts
    have, want, increase = amounts
    gain = np.float32(share) * ((want - have) / (increase + np.float32(1e-3))).clip(-1, LARGEST)
    size = (picture.shape[1], picture.shape[0])
    _amplify(fine, np.asarray(cv2.resize(gain, size, interpolation=cv2.INTER_LINEAR), np.float32), picture)
    return fine, amounts


def resized_amounts(amounts: Amounts, size: tuple[int, int]) -> Amounts:
    """The amounts for frames of another size (width, height), px."""
    if not amounts.size:
        return amounts
    cells = (-(-size[0] // CELL_PX), -(-size[1] // CELL_PX))
    return np.stack([np.asarray(cv2.resize(plane, cells, interpolation=cv2.INTER_LINEAR)) for plane in amounts])


def _blurred(picture: Picture) -> Picture:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), SIGMA_PX), np.float32)


def _amount(picture: Picture, coarse: Picture) -> Plane:
    """Sum of |picture - coarse| in each cell, averaged over the window: float32 (rows, columns)."""
    height, width = picture.shape[:2]
    cells = np.zeros((-(-height // CELL_PX), -(-width // CELL_PX)), np.float32)
    _sum_cells(picture, coarse, cells)
    return np.asarray(cv2.blur(cells, (WINDOW_CELLS, WINDOW_CELLS)), np.float32)


@kernel
def _sum_cells(picture: Any, coarse: Any, cells: Any) -> None:
    height, width, channels = picture.shape
    for y in range(height):
        for x in range(width):
            total = np.float32(0)
            for c in range(channels):
                total += abs(picture[y, x, c] - coarse[y, x, c])
            cells[y // CELL_PX, x // CELL_PX] += total


@kernel
def _amplify(fine: Any, gain: Any, picture: Any) -> None:
    """Replace the texture `fine` by `picture` with `gain` times the texture added."""
    height, width, channels = picture.shape
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                fine[y, x, c] = picture[y, x, c] + gain[y, x] * fine[y, x, c]
