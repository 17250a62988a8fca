"""Motion for label propagation: a still test that keeps a standing picture standing, and a settled frame.

Both are ours, beyond the paper: sensor noise is what makes a cartoon of a still scene crawl.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame
from pipeline.segmentation.jit import kernel

FAR = 255
"""The residual of a pixel with no counterpart in the previous frame."""


def hold_still(flow: Flow, previous_gray: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float) -> Flow:
    """Set `flow` (float32 (h, w, 2), px) to exactly zero where nothing moves; return it (changed in place).

    A pixel stands still when the mean absolute difference of the two grays over 5x5 is at most `tolerance`
    (levels, 0..255), or when its displacement is under a tenth of a pixel.
    """
    difference = cv2.boxFilter(cv2.absdiff(gray, previous_gray), -1, (5, 5))
    _zero_still(flow, difference, np.uint8(tolerance))
    return flow


@kernel
def _zero_still(flow: Flow, difference: NDArray[np.uint8], tolerance: np.uint8) -> None:
    height, width = difference.shape
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            if difference[y, x] <= tolerance or dx * dx + dy * dy < 0.01:
                flow[y, x, 0] = 0.0
                flow[y, x, 1] = 0.0


def settle(
    frame: Frame, settled: Frame, flow: Flow, memory: float, tolerance: float
) -> tuple[Frame, NDArray[np.uint8]]:
    """Average `frame` with the settled previous frame along the motion, where the two agree.

    Args:
        frame: current frame, uint8 (h, w, 3).
        settled: result for the previous frame, same shape.
        flow: previous to current frame, float32 (h, w, 2), px; taken at the target (flow varies slowly).
        memory: weight of the past where the two agree perfectly, 0..0.95.
        tolerance: RGB distance (levels) at which that weight has fallen to 1/e.

    Returns:
        The settled frame, and the residual: RGB distance to the past, uint8, 255 where there is none.
    """
    squared = np.arange(0, 4096, dtype=np.float32) * 4
    weights = (memory * np.exp(-squared / tolerance**2)).astype(np.float32)
    out = np.empty_like(frame)
    residual = np.empty(frame.shape[:2], np.uint8)
    _settle(frame, settled, flow, weights, out, residual)
    return out, residual


@kernel
def _settle(
    frame: Frame, settled: Frame, flow: Flow, weights: NDArray[np.float32], out: Frame, residual: NDArray[np.uint8]
) -> None:
    height, width = residual.shape
    past = np.empty(3, np.float32)
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            if dx == 0.0 and dy == 0.0:
                for c in range(3):
                    past[c] = settled[y, x, c]
            else:
                sx, sy = x - dx, y - dy
                if sx < 0 or sy < 0 or sx > width - 1 or sy > height - 1:
                    residual[y, x] = 255
                    for c in range(3):
                        out[y, x, c] = frame[y, x, c]
                    continue
                x0, y0 = int(sx), int(sy)
                x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
                fx, fy = np.float32(sx - x0), np.float32(sy - y0)
                for c in range(3):
                    top = settled[y0, x0, c] + fx * (np.float32(settled[y0, x1, c]) - np.float32(settled[y0, x0, c]))
                    low = settled[y1, x0, c] + fx * (np.float32(settled[y1, x1, c]) - np.float32(settled[y1, x0, c]))
                    past[c] = top + fy * (low - top)
            total = np.float32(0.0)
            for c in range(3):
                d = past[c] - frame[y, x, c]
                total += d * d
            residual[y, x] = np.uint8(min(254.0, np.sqrt(total)))
            index = int(total * 0.25)
            weight = weights[index] if index < weights.size else np.float32(0.0)
            for c in range(3):
                out[y, x, c] = np.uint8(frame[y, x, c] + weight * (past[c] - frame[y, x, c]) + np.float32(0.5))
