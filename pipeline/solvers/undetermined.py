"""Detection of pixels whose value is undetermined: no path of edges leads to a given value or an absorbing term."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.kernels.jit import kernel


def undetermined(anchored: NDArray[np.bool_], right: AnyArray, down: AnyArray) -> NDArray[np.bool_]:
    """Pixels from which no path over edges > 0 leads to an anchored one: bool (h, w).

    Args:
        anchored: bool (h, w): given or absorbing pixels.
        right: (h, w - 1), weights of the edges between horizontal neighbours, >= 0.
        down: (h - 1, w), between vertical ones.
    """
    reached = anchored.copy()
    _flood(reached, right, down)
    return ~reached


@kernel
def _flood(reached: NDArray[np.bool_], right: AnyArray, down: AnyArray) -> None:
    height, width = reached.shape
    stack = np.empty(height * width, np.int64)
    top = 0
    for place in range(height * width):
        if reached[place // width, place % width]:
            stack[top] = place
            top += 1
    while top > 0:
        top -= 1
        y, x = stack[top] // width, stack[top] % width
        for step in range(4):
            ny, nx = y + (step == 0) - (step == 1), x + (step == 2) - (step == 3)
            if ny < 0 or nx < 0 or ny >= height or nx >= width or reached[ny, nx]:
                continue
            weight = down[min(y, ny), x] if step < 2 else right[y, min(x, nx)]
            if weight > 0:
                reached[ny, nx] = True
                stack[top] = ny * width + nx
                top += 1
