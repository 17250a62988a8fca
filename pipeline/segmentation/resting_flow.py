"""Flow of what rests: exactly 0, so that noise moves neither regions nor strokes.

Departure: this is part of none of the papers. Without it, sensor noise moves the regions of a still scene.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.jit import kernel

TEXTURE = 64.0
"""Sobel slope at a quarter of the size from which on motion would be visible."""
WINDOW, GLOBAL = 0.15, 0.03
"""Side of the window, as a fraction of the frame's shorter side, in which textured pixels decide whether a flat pixel
rests; weight of the textured pixels of the whole picture."""
FAR, CONTESTED = 0.003, 0.9
"""A flat pixel that the flow moves by more than FAR, as a fraction of the shorter side, moves, unless at least the
fraction CONTESTED of the textures around it rests. Smaller motion may be an overshoot from a moving neighbour."""
SLOWEST2 = 0.01
"""Square of the displacement, px, below which a pixel rests whatever changes."""
_RESTS, _CONTESTED, _MOVES = 0, 1, 2


def zero_resting_flow(flow: Flow, before: NDArray[np.uint8], gray: NDArray[np.uint8], tolerance: float) -> Flow:
    """Set the flow of resting pixels to exactly 0, in place; return it: float32 (h, w, 2), px.

    A pixel that does not change may rest, or belong to a flat surface that moves, such as the sky in a pan or the roof
    of a car. An unchanged flat pixel therefore rests only if textured pixels around it do not change either. If some of
    them do, it rests only if the flow moves it little.

    Args:
        before, gray: uint8 (h, w), the previous frame and this one.
        tolerance: mean absolute difference over 5 x 5 px up to which a pixel counts as unchanged, gray levels, 0..254.
    """
    size = (gray.shape[1], gray.shape[0])
    small = (max(1, size[0] // 4), max(1, size[1] // 4))
    difference = cv2.absdiff(gray, before)
    change = np.asarray(cv2.resize(difference, small, interpolation=cv2.INTER_AREA), np.uint8)
    coarse = cv2.resize(gray, small, interpolation=cv2.INTER_AREA)
    across, down = (np.asarray(cv2.Sobel(coarse, cv2.CV_32F, *axes), np.float32) for axes in ((1, 0), (0, 1)))
    resting, texture = np.empty_like(across), np.empty_like(across)
    far, all_far = _mark_texture(across, down, change, np.uint8(tolerance), resting, texture)
    side = max(3, round(WINDOW * min(small))) | 1
    near, all_near = (np.asarray(cv2.boxFilter(plane, -1, (side, side)), np.float32) for plane in (resting, texture))
    decisions = np.empty(across.shape, np.uint8)
    _decide(near, all_near, far, all_far, decisions)
    around = np.asarray(cv2.boxFilter(difference, -1, (5, 5)), np.uint8)
    _zero(flow, around, np.uint8(tolerance), decisions, np.float32((FAR * min(size)) ** 2))
    return flow


@kernel
def _mark_texture(
    across: Plane, down: Plane, change: NDArray[np.uint8], tolerance: np.uint8, resting: Plane, texture: Plane
) -> tuple[np.float32, np.float32]:
    """Write 1 where there is texture, and where it does not change, else 0; returns the weights of the whole picture's
    textures, resting and all."""
    height, width = across.shape
    count, rests = 0, 0
    for y in range(height):
        for x in range(width):
            textured = abs(across[y, x]) + abs(down[y, x]) > np.float32(TEXTURE)
            still = textured and change[y, x] <= tolerance
            texture[y, x], resting[y, x] = np.float32(textured), np.float32(still)
            count += textured
            rests += still
    size, weight, least = np.float32(across.size), np.float32(GLOBAL), np.float32(1e-6)
    return weight * (np.float32(rests) / size) + least, weight * (np.float32(count) / size) + least


@kernel
def _decide(
    near: Plane, all_near: Plane, far: np.float32, all_far: np.float32, decisions: NDArray[np.uint8]
) -> None:  # fmt: skip
    """Write what flat pixels do, by the shares of textures that rest, and of all, nearby and in the whole picture."""
    for y in range(decisions.shape[0]):
        for x in range(decisions.shape[1]):
            votes, total = near[y, x] + far, all_near[y, x] + all_far
            contested = votes < np.float32(CONTESTED) * total
            decisions[y, x] = (_MOVES if contested else _CONTESTED) if votes + votes <= total else contested


@kernel
def _zero(
    flow: Flow, change: NDArray[np.uint8], tolerance: np.uint8, decisions: NDArray[np.uint8], most2: np.float32
) -> None:
    """Zero the flow of resting pixels. `most2`: square of the largest motion of a contested pixel that rests."""
    (height, width), (rows, columns) = change.shape, decisions.shape
    decided = np.empty(width, np.uint8)
    nearest = np.arange(width) * columns // width
    for y in range(height):
        own = decisions[y * rows // height]
        for x in range(width):
            decided[x] = own[nearest[x]]
        pairs, changes = flow[y].reshape(2 * width), change[y]
        for x in range(width):  # this vectorises
            dx, dy = pairs[2 * x], pairs[2 * x + 1]
            far2 = dx * dx + dy * dy
            moves = (decided[x] == _MOVES) | ((decided[x] == _CONTESTED) & (far2 > most2))
            rests = ((changes[x] <= tolerance) & (not moves)) | (far2 < np.float32(SLOWEST2))
            pairs[2 * x] = np.float32(0) if rests else dx
            pairs[2 * x + 1] = np.float32(0) if rests else dy
