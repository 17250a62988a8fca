"""Motion for label propagation: a still test that keeps a standing picture standing, and a settled frame.

Both are ours, beyond the paper: sensor noise is what makes a cartoon of a still scene crawl.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.background import INLINE, Background
from pipeline.colour.lab8 import LabPlanes
from pipeline.frames import Flow, Frame
from pipeline.jit import kernel
from pipeline.segmentation.regions import Lab8

BackwardMaps: TypeAlias = tuple[NDArray[np.int16], NDArray[np.uint16]]
"""Fixed-point maps for `cv2.remap`: (h, w, 2) whole pixels, (h, w) fractions."""
RESIDUAL_STEPS = 4
"""A residual counts quarters of a CIELAB unit."""
FAR = 255
"""The residual of a pixel with no counterpart in the previous frame."""
MOVING = 0.6
"""Share of the memory that moving pixels have."""
FADE_TOLERANCE = 10.0
"""CIELAB units of residual at which the previous paint's weight has fallen to 1/e."""


def median_motion(flow: NDArray[np.float32]) -> NDArray[np.float32]:
    """The median of vectors (..., 2), px, by x and by y; of an even number, the upper of the two in the middle."""
    rows = flow.reshape(-1, 2)
    middle = len(rows) // 2
    return np.asarray(np.partition(rows, middle, axis=0)[middle], np.float32)


def zero_still_flow(
    flow: Flow, previous_gray: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float,
    moving: NDArray[np.uint8] | None = None,
) -> Flow:  # fmt: skip
    """Set `flow` (float32 (h, w, 2), px) to exactly zero where nothing moves; return it (changed in place).

    A pixel stands still when the mean absolute difference of the two grays over 5x5 is at most `tolerance`
    (levels, 0..255), or when its displacement is under a tenth of a pixel. Where `moving` (uint8 (h, w)) is not 0, only
    the latter counts.
    """
    difference = np.asarray(cv2.boxFilter(cv2.absdiff(gray, previous_gray), -1, (5, 5)), np.uint8)
    if moving is not None:
        difference = np.asarray(np.where(moving, np.uint8(255), difference), np.uint8)
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


def backward_maps(flow: Flow) -> BackwardMaps:
    """Where each pixel was in the previous frame, as OpenCV's fixed-point maps (1/32 px): made once, used by all."""
    where = _grid(flow.shape[1], flow.shape[0]) - flow
    whole, fractions = cv2.convertMaps(where, _NO_SECOND_MAP, cv2.CV_16SC2)
    return np.asarray(whole, np.int16), np.asarray(fractions, np.uint16)


@lru_cache(maxsize=4)
def _grid(width: int, height: int) -> NDArray[np.float32]:
    return np.stack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)), axis=-1)


def warp_back(image: NDArray[np.uint8], back: BackwardMaps) -> NDArray[np.uint8]:
    """The previous frame's `image`, uint8 (h, w[, c]), moved to this frame, bilinear; borders repeat."""
    return np.asarray(cv2.remap(image, *back, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def denoise(
    lab: LabPlanes, denoised: Lab8, flow: Flow, back: BackwardMaps, memory: float, tolerance: float
) -> tuple[LabPlanes, NDArray[np.uint8]]:  # fmt: skip
    """Average a frame with the settled previous one along the motion, where the two agree.

    Args:
        lab: current frame, uint8 (3, h, w).
        denoised: result for the previous frame, uint8 (h, w, 3).
        flow: previous to current frame, float32 (h, w, 2), px; taken at the target (flow varies slowly).
        back: of `flow`.
        memory: weight of the past where the two agree perfectly and stand still, 0..0.95; `MOVING` of that where
            they move, since every bilinear sample of a sample blurs a little more.
        tolerance: CIELAB difference at which that weight has fallen to 1/e.

    Returns:
        The settled frame by planes, and the residual: uint8 (h, w), CIELAB difference to the bilinear sample of the
        past, in quarter units (255 = 63.75 or more, or no counterpart).
    """
    size = lab[0].size
    mixed = np.empty_like(lab)
    cv2.split(warp_back(denoised, back), list(mixed))
    here, past = lab.reshape(3, size), mixed.reshape(3, size)  # by plane, these loops vectorise
    residual = np.empty(lab.shape[1:], np.uint8)
    weights = np.empty(lab.shape[1:], np.int16)
    _difference(here, past, residual.ravel())
    _weigh(flow, _weights(memory, tolerance), _weights(memory * MOVING, tolerance), residual, weights)
    _mix(here, past, weights.ravel())
    return mixed, residual


def blend_with_past(
    picture: Frame, past: Frame, residual: NDArray[np.uint8], memory: float, background: Background = INLINE
) -> Frame:  # fmt: skip
    """Blend an output with the previous one, weight `memory` where the SOURCE agrees with

    its past (within about `FADE_TOLERANCE` CIELAB units): where nothing happened, paint must not jump; it fades over.

    Args:
        picture: uint8 (h, w, 3), this output.
        past: the previous one, moved here (`warp_back`); overwritten.
        residual: of the source, as in `denoise`.
        memory: 0..0.95.

    Returns: uint8 (h, w, 3), `past`.
    """
    weights = past_weights(memory)
    background.rows(
        lambda first, last: _fade(picture[first:last], past[first:last], residual[first:last], weights), len(picture)
    )
    return past


def past_weights(memory: float) -> NDArray[np.int32]:
    """Weight of the previous frame's colours by residual (as in `denoise`), int32 (256,), 256 = 1.

    `memory`, 0..0.95, where the source agrees with its past; falls with `FADE_TOLERANCE`.
    """
    return _weights(memory, FADE_TOLERANCE)


@lru_cache(maxsize=64)
def _weights(memory: float, tolerance: float) -> NDArray[np.int32]:
    """Weight of the past by residual, int32 (256,), 256 = 1."""
    difference = np.arange(256) / RESIDUAL_STEPS
    weights = memory * np.exp(-((difference / tolerance) ** 2))
    weights[FAR] = 0
    return np.rint(weights * 256).astype(np.int32)


@kernel
def _difference(now: NDArray[np.uint8], past: NDArray[np.uint8], residual: NDArray[np.uint8]) -> None:
    """CIELAB difference in quarter units, 254 at most."""
    for k in range(residual.size):
        dl = np.int32(past[0, k]) - np.int32(now[0, k])
        da = np.int32(past[1, k]) - np.int32(now[1, k])
        db = np.int32(past[2, k]) - np.int32(now[2, k])
        # In sixteenths of a squared unit: L is scaled by 255/100, hence its square by 630/256/16.
        square = min(np.int32(65024), ((630 * dl * dl) >> 8) + 16 * (da * da + db * db))
        residual[k] = np.uint8(np.sqrt(np.float32(square)))


@kernel
def _weigh(
    flow: Flow, still: NDArray[np.int32], moving: NDArray[np.int32], residual: NDArray[np.uint8],
    weights: NDArray[np.int16],
) -> None:  # fmt: skip
    """The weight of the past; `residual` becomes `FAR` where there is none."""
    height, width = residual.shape
    for y in range(height):
        for x in range(width):
            dx, dy = flow[y, x, 0], flow[y, x, 1]
            weight = still[residual[y, x]]
            if dx != 0.0 or dy != 0.0:
                weight = moving[residual[y, x]]
                if x < dx or y < dy or x - dx > width - 1 or y - dy > height - 1:
                    residual[y, x], weight = np.uint8(255), np.int32(0)
            weights[y, x] = weight


@kernel
def _mix(now: NDArray[np.uint8], past: NDArray[np.uint8], weights: NDArray[np.int16]) -> None:
    """Overwrites `past` with the average."""
    for plane in range(3):
        a, b = now[plane], past[plane]
        for k in range(weights.size):
            b[k] = np.uint8(a[k] + ((np.int32(weights[k]) * (np.int32(b[k]) - np.int32(a[k])) + 128) >> 8))


@kernel
def _fade(picture: Frame, past: Frame, residual: NDArray[np.uint8], weights: NDArray[np.int32]) -> None:
    """Overwrites `past` with the blend."""
    height, width = residual.shape
    by_byte = np.empty(3 * width, np.int32)
    for y in range(height):
        for x in range(width):
            by_byte[3 * x] = by_byte[3 * x + 1] = by_byte[3 * x + 2] = weights[residual[y, x]]
        now, then = picture[y].reshape(by_byte.size), past[y].reshape(by_byte.size)
        for k in range(by_byte.size):  # this vectorises
            then[k] = np.uint8(now[k] + ((by_byte[k] * (np.int32(then[k]) - np.int32(now[k])) + 128) >> 8))
