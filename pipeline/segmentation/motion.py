"""Motion for label propagation: a still test that keeps a standing picture standing, and a settled frame.

Both are ours, beyond the paper: sensor noise is what makes a cartoon of a still scene crawl.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.regions import Lab8

RESIDUAL_STEPS = 4
"""A residual counts quarters of a CIELAB unit."""
FAR = 255
"""The residual of a pixel with no counterpart in the previous frame."""
MOVING = 0.6
"""Share of the memory that moving pixels have."""
FADE_TOLERANCE = 6.0
"""CIELAB units of residual at which the previous paint's weight has fallen to 1/e."""


def hold_still(flow: Flow, previous_gray: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float) -> Flow:
    """Set `flow` (float32 (h, w, 2), px) to exactly zero where nothing moves; return it (changed in place).

    A pixel stands still when the mean absolute difference of the two grays over 5x5 is at most `tolerance`
    (levels, 0..255), or when its displacement is under a tenth of a pixel.
    """
    difference = np.asarray(cv2.boxFilter(cv2.absdiff(gray, previous_gray), -1, (5, 5)), np.uint8)
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
    lab: Lab8, settled: Lab8, flow: Flow, memory: float, tolerance: float
) -> tuple[Lab8, NDArray[np.uint8]]:  # fmt: skip
    """Average a frame with the settled previous one along the motion, where the two agree.

    Args:
        lab: current frame, uint8 (h, w, 3).
        settled: result for the previous frame, same shape.
        flow: previous to current frame, float32 (h, w, 2), px; taken at the target (flow varies slowly).
        memory: weight of the past where the two agree perfectly and stand still, 0..0.95; `MOVING` of that where
            they move, since every bilinear sample of a sample blurs a little more.
        tolerance: CIELAB difference at which that weight has fallen to 1/e.

    Returns:
        The settled frame, and the residual: uint8 (h, w), CIELAB difference to the bilinear sample of the past, in
        quarter units (255 = 63.75 or more, or no counterpart).
    """
    out = np.empty_like(lab)
    residual = np.empty(lab.shape[:2], np.uint8)
    _settle(lab, settled, flow, _weights(memory, tolerance), out, residual)
    return out, residual


def fade(picture: Frame, before: Frame, flow: Flow, residual: NDArray[np.uint8], memory: float) -> Frame:
    """Blend an output with the previous output moved along the flow, weight `memory` where the SOURCE agrees with

    its past (within about `FADE_TOLERANCE` CIELAB units): where nothing happened, paint must not jump; it fades over.

    Args:
        picture, before: uint8 (h, w, 3), this and the previous output.
        flow, residual: of the source, as in `settle`.
        memory: 0..0.95.

    Returns: uint8 (h, w, 3).
    """
    out = np.empty_like(picture)
    _fade(picture, before, flow, residual, _weights(memory, FADE_TOLERANCE), out)
    return out


def _weights(memory: float, tolerance: float) -> NDArray[np.float32]:
    """Weight of the past by residual, float32 (256,)."""
    difference = np.arange(256) / RESIDUAL_STEPS
    weights = memory * np.exp(-((difference / tolerance) ** 2))
    weights[FAR] = 0
    return weights.astype(np.float32)


@kernel
def _sample(image: NDArray[np.uint8], x: float, y: float, out: NDArray[np.float32]) -> bool:
    """Bilinear sample of an (h, w, 3) image at (x, y); False outside."""
    height, width = image.shape[0], image.shape[1]
    if x < 0 or y < 0 or x > width - 1 or y > height - 1:
        return False
    x0, y0 = int(x), int(y)
    x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
    fx, fy = np.float32(x - x0), np.float32(y - y0)
    for c in range(3):
        top = image[y0, x0, c] + fx * (np.float32(image[y0, x1, c]) - np.float32(image[y0, x0, c]))
        low = image[y1, x0, c] + fx * (np.float32(image[y1, x1, c]) - np.float32(image[y1, x0, c]))
        out[c] = top + fy * (low - top)
    return True


@kernel
def _settle(
    lab: Lab8, settled: Lab8, flow: Flow, weights: NDArray[np.float32], out: Lab8, residual: NDArray[np.uint8]
) -> None:  # fmt: skip
    height, width = residual.shape
    past = np.empty(3, np.float32)
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            if dx == 0.0 and dy == 0.0:
                for c in range(3):
                    past[c] = settled[y, x, c]
            elif not _sample(settled, x - dx, y - dy, past):
                residual[y, x] = 255
                for c in range(3):
                    out[y, x, c] = lab[y, x, c]
                continue
            dl = (past[0] - lab[y, x, 0]) * np.float32(100.0 / 255.0)
            da = past[1] - lab[y, x, 1]
            db = past[2] - lab[y, x, 2]
            far = np.uint8(min(np.float32(254.0), np.float32(4.0) * np.sqrt(dl * dl + da * da + db * db)))
            residual[y, x] = far
            weight = weights[far] if dx == 0.0 and dy == 0.0 else weights[far] * np.float32(MOVING)
            for c in range(3):
                out[y, x, c] = np.uint8(lab[y, x, c] + weight * (past[c] - lab[y, x, c]) + np.float32(0.5))


@kernel
def _fade(
    picture: Frame, before: Frame, flow: Flow, residual: NDArray[np.uint8], weights: NDArray[np.float32], out: Frame
) -> None:  # fmt: skip
    height, width = residual.shape
    past = np.empty(3, np.float32)
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            weight = weights[residual[y, x]]
            if dx == 0.0 and dy == 0.0:
                for c in range(3):
                    past[c] = before[y, x, c]
            elif weight == 0 or not _sample(before, x - dx, y - dy, past):
                weight = np.float32(0.0)
            for c in range(3):
                now = np.float32(picture[y, x, c])
                out[y, x, c] = (
                    np.uint8(now + weight * (past[c] - now) + np.float32(0.5)) if weight else picture[y, x, c]
                )
