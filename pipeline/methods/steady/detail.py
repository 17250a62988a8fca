"""Restoration of the texture that averaging along the motion has blurred."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.buffers import Buffers
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


def restore_detail(
    picture: Picture, styled: Picture, share: float, before: Amounts, buffers: Buffers
) -> tuple[Picture, Plane, Amounts]:
    """The texture of `picture`, and the gain that brings it to the amount that the styled frames have around a pixel.

    An average of n frames with independent texture keeps 1/sqrt(n) of its contrast. Amplification restores the
    contrast; the texture stays that of the average, which changes slowly.

    Args:
        picture, styled: float32 (h, w, 3), 0..255.
        share: of the missing texture that is restored, 0..1.
        before: amounts at the last frame.
        buffers: memory to work in. The texture lies there until the next call with the same `buffers`.

    Returns:
        The texture, float32 (h, w, 3); what to multiply it with before it is added to the picture, float32 (h, w),
        -1..LARGEST; and the amounts at this frame.
    """
    fine = buffers.get("texture", picture.shape)
    have = _amount(picture, fine, buffers)
    other = buffers.get("texture of others", picture.shape)
    amounts = np.stack([have, _amount(styled, other, buffers), _amount(fine, other, buffers)])
    if before.size:
        amounts = MEMORY * before + (1 - MEMORY) * amounts
    have, want, increase = amounts
    gain = np.float32(share) * ((want - have) / (increase + np.float32(1e-3))).clip(-1, LARGEST)
    size = (picture.shape[1], picture.shape[0])
    return fine, np.asarray(cv2.resize(gain, size, interpolation=cv2.INTER_LINEAR), np.float32), amounts


def resized_amounts(amounts: Amounts, size: tuple[int, int]) -> Amounts:
    """The amounts for frames of another size (width, height), px."""
    if not amounts.size:
        return amounts
    cells = (-(-size[0] // CELL_PX), -(-size[1] // CELL_PX))
    return np.stack([np.asarray(cv2.resize(plane, cells, interpolation=cv2.INTER_LINEAR)) for plane in amounts])


def _amount(picture: Picture, fine: Picture, buffers: Buffers) -> Plane:
    """Sum of the texture of `picture` in each cell, averaged over the window: float32 (rows, columns). `fine` is filled
    with the texture."""
    height, width = picture.shape[:2]
    coarse = buffers.get("blurred", picture.shape)
    cv2.GaussianBlur(picture, (0, 0), SIGMA_PX, dst=coarse)
    cells = np.zeros((-(-height // CELL_PX), -(-width // CELL_PX)), np.float32)
    rows = (height, width * picture.shape[2])
    _subtract(picture.reshape(rows), coarse.reshape(rows), CELL_PX * picture.shape[2], fine.reshape(rows), cells)
    return np.asarray(cv2.blur(cells, (WINDOW_CELLS, WINDOW_CELLS)), np.float32)


@kernel
def _subtract(picture: Any, coarse: Any, cell: Any, fine: Any, cells: Any) -> None:
    """Fill `fine` with picture - coarse, and `cells` with the sums of its absolute values; a cell has `cell` values of
    each row."""
    height, width = picture.shape
    column = np.empty(width, np.float32)
    for row in range(cells.shape[0]):
        column[:] = 0
        for y in range(row * CELL_PX, min((row + 1) * CELL_PX, height)):
            p, q, f = picture[y], coarse[y], fine[y]
            for j in range(width):
                f[j] = p[j] - q[j]
                column[j] += abs(f[j])
        for i in range(cells.shape[1]):
            total = np.float32(0)
            for j in range(i * cell, min((i + 1) * cell, width)):
                total += column[j]
            cells[row, i] = total
