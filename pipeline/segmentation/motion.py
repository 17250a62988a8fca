"""Motion for label propagation: a still test that keeps a standing picture standing, and a settled frame.

Both are ours, beyond the paper: sensor noise is what makes a cartoon of a still scene crawl.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.regions import Lab8

WayBack: TypeAlias = tuple[NDArray[np.int16], NDArray[np.uint16]]
"""Fixed-point maps for `cv2.remap`: (h, w, 2) whole pixels, (h, w) fractions."""
RESIDUAL_STEPS = 4
"""A residual counts quarters of a CIELAB unit."""
FAR = 255
"""The residual of a pixel with no counterpart in the previous frame."""
MOVING = 0.6
"""Share of the memory that moving pixels have."""
FADE_TOLERANCE = 10.0
"""CIELAB units of residual at which the previous paint's weight has fallen to 1/e."""

_ROOTS = np.minimum(np.sqrt(np.arange(65025)), 254).astype(np.uint8)
"""Whole square roots of 0..65024."""


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


_NO_SECOND_MAP = np.empty(0, np.float32)


def way_back(flow: Flow) -> WayBack:
    """Where each pixel was in the previous frame, as OpenCV's fixed-point maps (1/32 px): made once, used by all."""
    where = _grid(flow.shape[1], flow.shape[0]) - flow
    whole, fractions = cv2.convertMaps(where, _NO_SECOND_MAP, cv2.CV_16SC2)
    return np.asarray(whole, np.int16), np.asarray(fractions, np.uint16)


@lru_cache(maxsize=4)
def _grid(width: int, height: int) -> NDArray[np.float32]:
    return np.stack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)), axis=-1)


def bring(image: NDArray[np.uint8], back: WayBack) -> NDArray[np.uint8]:
    """The previous frame's `image`, uint8 (h, w[, c]), moved to this frame, bilinear; borders repeat."""
    return np.asarray(cv2.remap(image, *back, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def settle(
    lab: Lab8, settled: Lab8, flow: Flow, back: WayBack, memory: float, tolerance: float
) -> tuple[Lab8, NDArray[np.uint8]]:  # fmt: skip
    """Average a frame with the settled previous one along the motion, where the two agree.

    Args:
        lab: current frame, uint8 (h, w, 3).
        settled: result for the previous frame, same shape.
        flow: previous to current frame, float32 (h, w, 2), px; taken at the target (flow varies slowly).
        back: of `flow`.
        memory: weight of the past where the two agree perfectly and stand still, 0..0.95; `MOVING` of that where
            they move, since every bilinear sample of a sample blurs a little more.
        tolerance: CIELAB difference at which that weight has fallen to 1/e.

    Returns:
        The settled frame, and the residual: uint8 (h, w), CIELAB difference to the bilinear sample of the past, in
        quarter units (255 = 63.75 or more, or no counterpart).
    """
    past = bring(settled, back)
    residual = np.empty(lab.shape[:2], np.uint8)
    _settle(lab, past, flow, _weights(memory, tolerance), _weights(memory * MOVING, tolerance), _ROOTS, residual)
    return past, residual


def fade(
    picture: Frame, before: Frame, back: WayBack, residual: NDArray[np.uint8], memory: float
) -> Frame:  # fmt: skip
    """Blend an output with the previous output moved along the flow, weight `memory` where the SOURCE agrees with

    its past (within about `FADE_TOLERANCE` CIELAB units): where nothing happened, paint must not jump; it fades over.

    Args:
        picture, before: uint8 (h, w, 3), this and the previous output.
        back, residual: of the source, as in `settle`.
        memory: 0..0.95.

    Returns: uint8 (h, w, 3).
    """
    past = bring(before, back)
    _fade(picture, past, residual, _weights(memory, FADE_TOLERANCE))
    return past


@lru_cache(maxsize=64)
def _weights(memory: float, tolerance: float) -> NDArray[np.int32]:
    """Weight of the past by residual, int32 (256,), 256 = 1."""
    difference = np.arange(256) / RESIDUAL_STEPS
    weights = memory * np.exp(-((difference / tolerance) ** 2))
    weights[FAR] = 0
    return np.rint(weights * 256).astype(np.int32)


@kernel
def _settle(
    lab: Lab8, past: Lab8, flow: Flow, still: NDArray[np.int32], moving: NDArray[np.int32], roots: NDArray[np.uint8],
    residual: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Overwrites `past` with the settled frame."""
    height, width = residual.shape
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            light, a, b = np.int32(lab[y, x, 0]), np.int32(lab[y, x, 1]), np.int32(lab[y, x, 2])
            dl, da, db = past[y, x, 0] - light, past[y, x, 1] - a, past[y, x, 2] - b
            # In sixteenths of a squared unit: L is scaled by 255/100, hence its square by 630/256/16.
            far = roots[min(65024, ((630 * dl * dl) >> 8) + 16 * (da * da + db * db))]
            weight = still[far]
            if dx != 0.0 or dy != 0.0:
                weight = moving[far]
                if x < dx or y < dy or x - dx > width - 1 or y - dy > height - 1:
                    far, weight = np.uint8(255), np.int32(0)
            residual[y, x] = far
            past[y, x, 0] = np.uint8(light + ((weight * dl + 128) >> 8))
            past[y, x, 1] = np.uint8(a + ((weight * da + 128) >> 8))
            past[y, x, 2] = np.uint8(b + ((weight * db + 128) >> 8))


@kernel
def _fade(picture: Frame, past: Frame, residual: NDArray[np.uint8], weights: NDArray[np.int32]) -> None:
    """Overwrites `past` with the blend."""
    height, width = residual.shape
    for y in range(height):
        for x in range(width):
            weight = weights[residual[y, x]]
            for c in range(3):
                now = np.int32(picture[y, x, c])
                past[y, x, c] = np.uint8(now + ((weight * (past[y, x, c] - now) + 128) >> 8))
