"""Inversion of a flow: from the flow of one frame, the flow of the other frame in the opposite direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Mask
from pipeline.kernels.jit import kernel

_ONE, _ZERO = np.float32(1.0), np.float32(0.0)


def invert_flow(flow: Flow, here: NDArray[np.uint8], there: NDArray[np.uint8]) -> tuple[Flow, Mask]:
    """Flow from `there` to `here`, float32 (h, w, 2), px; and pixels of `there` that are visible in `here`, bool (h,
    w).

    Each pixel of `here` is a candidate for the four pixels of `there` around its target. Of several candidates, the one
    with the most similar brightness is used, so that a moving object wins over the background that it covers. A pixel
    of `there` without candidate is hidden in `here`, and its flow is the negative of the flow at the same place.

    Args:
        flow: from `here` to `there`: here(x) matches there(x + flow(x)).
        here, there: uint8 (h, w).
    """
    out, best = np.empty_like(flow), np.full(flow.shape[:2], np.inf, np.float32)
    _scatter(flow, here, there, out, best)
    visible = np.asarray(np.isfinite(best), np.bool_)
    np.negative(flow, out=out, where=~visible[..., None])
    return out, visible


@kernel
def _scatter(
    flow: Flow, here: NDArray[np.uint8], there: NDArray[np.uint8], out: Flow, best: NDArray[np.float32]
) -> None:  # fmt: skip
    height, width = best.shape
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            if dx == _ZERO and dy == _ZERO:  # a candidate for one pixel only
                apart = abs(np.float32(here[y, x]) - np.float32(there[y, x]))
                if apart < best[y, x]:
                    best[y, x] = apart
                    out[y, x, 0] = -dx
                    out[y, x, 1] = -dy
                continue
            tx, ty = np.float32(x) + dx, np.float32(y) + dy
            if tx <= -_ONE or ty <= -_ONE or tx >= np.float32(width) or ty >= np.float32(height):
                continue
            left, top = int(np.floor(tx)), int(np.floor(ty))
            for row in range(max(top, 0), min(top + 2, height)):
                for column in range(max(left, 0), min(left + 2, width)):
                    away = max(abs(np.float32(column) - tx), abs(np.float32(row) - ty))
                    if away >= _ONE:
                        continue
                    apart = abs(np.float32(here[y, x]) - np.float32(there[row, column])) + away
                    if apart < best[row, column]:
                        best[row, column] = apart
                        out[row, column, 0] = -dx
                        out[row, column, 1] = -dy
