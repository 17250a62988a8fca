"""Motion for label propagation: detection of still pixels, and temporal denoising along the motion.

Departure: neither is part of zhang2011online. Without them, sensor noise moves the regions of a still scene.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.colour.lab8 import Lab8, LabPlanes
from pipeline.frames import Flow
from pipeline.kernels.jit import kernel
from pipeline.kernels.selection import column_medians
from pipeline.perception.backward_maps import BackwardMaps, warp_back_mapped
from pipeline.perception.flow.warp import warp_back

RESIDUAL_STEPS = 4
"""Steps of a residual per CIELAB unit."""
FAR = 255
"""Residual of a pixel without counterpart in the previous frame."""
FADE_TOLERANCE = 10.0
"""Residual, CIELAB units, at which the weight of the previous output has fallen to 1/e."""


def median_motion(flow: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median of vectors (..., 2), px, separately for x and y; the upper median for an even number: float32 (2,)."""
    return column_medians(flow)


def zero_still_flow(
    flow: Flow, previous_gray: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float,
    moving: NDArray[np.uint8] | None = None,
) -> Flow:  # fmt: skip
    """Set the flow of still pixels to exactly 0, in place; returns it: float32 (h, w, 2), px.

    A pixel is still if the mean absolute difference of the two frames over 5x5 px is at most `tolerance`, or if its
    displacement is less than a tenth of a pixel.

    Args:
        previous_gray, gray: uint8 (h, w).
        tolerance: gray levels, 0..255.
        moving: uint8 (h, w); where it is not 0, only the displacement counts. None = 0 everywhere.
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
        pairs, changes = flow[y].reshape(2 * width), difference[y]
        for x in range(width):  # this vectorises
            dx, dy = pairs[2 * x], pairs[2 * x + 1]
            still = (changes[x] <= tolerance) | (dx * dx + dy * dy < 0.01)
            pairs[2 * x] = np.float32(0) if still else dx
            pairs[2 * x + 1] = np.float32(0) if still else dy


def denoise(
    lab: LabPlanes, denoised: Lab8, flow: Flow, back: BackwardMaps, memory: float, tolerance: float
) -> tuple[LabPlanes, NDArray[np.uint8]]:  # fmt: skip
    """Average the still pixels of a frame with the denoised previous frame, where the two agree.

    Moving pixels stay as they are: repeated bilinear sampling along an inexact flow would blur them, and hardly makes
    regions steadier.

    Args:
        lab: current frame, uint8 (3, h, w).
        denoised: result for the previous frame, uint8 (h, w, 3).
        flow: previous to current frame, float32 (h, w, 2), px; read at the target, since flow varies slowly.
        back: `backward_maps(flow)`.
        memory: weight of the past for pixels without difference, 0..0.95.
        tolerance: CIELAB difference at which the weight has fallen to 1/e.

    Returns:
        The denoised frame, uint8 (3, h, w), and the residual, uint8 (h, w): CIELAB difference to the bilinear sample of
        the past in quarter units; 255 = at least 63.75, or no counterpart.
    """
    size = lab[0].size
    mixed = np.empty_like(lab)
    cv2.split(warp_back_mapped(denoised, back), list(mixed))
    here, past = lab.reshape(3, size), mixed.reshape(3, size)  # by plane, these loops vectorise
    residual = np.empty(lab.shape[1:], np.uint8)
    weights = np.empty(lab.shape[1:], np.int16)
    _difference(here, past, residual.ravel())
    _weigh(_weights(memory, tolerance).astype(np.int16), residual, weights)
    _fill_places(weights, back.places, 0)
    _fill_places(residual, back.lost, FAR)
    _mix(here, past, weights.ravel())
    return mixed, residual


def flow_error(before: Lab8, now: LabPlanes, flow: Flow) -> NDArray[np.uint8]:
    """The error of the flow as zhang2011online prints it: uint8 (h, w), quarter CIELAB units, at the target.

    The colour of each pixel of the frame before is compared with the bilinear sample of this frame where the flow
    leads. A target with several sources has the largest of their errors, one without source has 0.

    Args:
        before: uint8 (h, w, 3).
        now: uint8 (3, h, w).
        flow: from `before` to `now`, float32 (h, w, 2), px.
    """
    height, width = before.shape[:2]
    moved = np.asarray(warp_back(np.asarray(cv2.merge(list(now)), np.uint8), flow), np.uint8)
    error, found = np.empty(height * width, np.uint8), np.zeros(height * width, np.uint8)
    _difference(_rows(before), _rows(moved), error)
    y, x = np.mgrid[:height, :width]
    x, y = x + np.floor(flow[..., 0] + 0.5).astype(np.int64), y + np.floor(flow[..., 1] + 0.5).astype(np.int64)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    np.maximum.at(found, (y * width + x)[inside], error[inside.ravel()])
    return found.reshape(height, width)


def _rows(lab: Lab8) -> NDArray[np.uint8]:
    """The planes of a picture, uint8 (3, h * w)."""
    return np.ascontiguousarray(lab.reshape(-1, 3).T)


def past_weights(memory: float) -> NDArray[np.int32]:
    """Weight of the previous frame's colours by residual (see `denoise`), int32 (256,), 256 = 1.

    Args:
        memory: weight at residual 0, 0..0.95; it falls to 1/e at `FADE_TOLERANCE`.
    """
    return _weights(memory, FADE_TOLERANCE)


@lru_cache(maxsize=64)
def _weights(memory: float, tolerance: float) -> NDArray[np.int32]:
    """Weight of the past by residual: int32 (256,), 256 = 1."""
    difference = np.arange(256) / RESIDUAL_STEPS
    weights = memory * np.exp(-((difference / tolerance) ** 2))
    weights[FAR] = 0
    return np.rint(weights * 256).astype(np.int32)


@kernel
def _difference(now: NDArray[np.uint8], past: NDArray[np.uint8], residual: NDArray[np.uint8]) -> None:
    """Write the CIELAB difference in quarter units, at most 254."""
    for k in range(residual.size):
        dl = np.int32(past[0, k]) - np.int32(now[0, k])
        da = np.int32(past[1, k]) - np.int32(now[1, k])
        db = np.int32(past[2, k]) - np.int32(now[2, k])
        # In sixteenths of a squared unit: L is scaled by 255/100, hence its square by 630/256/16.
        square = min(np.int32(65024), ((630 * dl * dl) >> 8) + 16 * (da * da + db * db))
        residual[k] = np.uint8(np.sqrt(np.float32(square)))


@kernel
def _weigh(still: NDArray[np.int16], residual: NDArray[np.uint8], weights: NDArray[np.int16]) -> None:
    """Write the weight of the past, 256 = 1, as if no pixel moved. `still`: weight by residual."""
    apart, out = residual.reshape(residual.size), weights.reshape(weights.size)
    for k in range(apart.size):
        out[k] = still[apart[k]]


@kernel
def _fill_places(plane: AnyArray, places: NDArray[np.int32], value: int) -> None:
    """Write a value at these flat indices."""
    flat = plane.reshape(plane.size)
    for k in range(places.size):
        flat[np.uint64(places[k])] = value


@kernel
def _mix(now: NDArray[np.uint8], past: NDArray[np.uint8], weights: NDArray[np.int16]) -> None:
    """Overwrite `past` with the average."""
    for plane in range(3):
        a, b = now[plane], past[plane]
        for k in range(weights.size):
            b[k] = np.uint8(a[k] + ((np.int32(weights[k]) * (np.int32(b[k]) - np.int32(a[k])) + 128) >> 8))
