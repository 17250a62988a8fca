"""Trapped-ball filling: zhang2011online, section 4.4, after zhang2009trapped."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel

SMALLEST_RADIUS_PX = 1
TAPPED_UP_TO_PX = 4
"""Above this radius, distance transforms of the whole frame are faster than trying every disc."""
SPARSE_UP_TO_PX, SPARSE = 16, 1 / 8
"""Up to this radius discs are tried all the same when less than this share of the frame is unlabelled."""


def radii(unlabelled_px: int) -> list[int]:
    """Ball radii from max(2, sqrt(N0) / 30) down to 1, halved each time, px."""
    radius = max(2, round(unlabelled_px**0.5 / 30))
    found = []
    while radius >= SMALLEST_RADIUS_PX:
        found.append(radius)
        radius //= 2
    return found


def fill(
    labels: Labels, blocked: NDArray[np.uint8], pixels: NDArray[np.int32], radius_px: int, first_label: int
) -> int:  # fmt: skip
    """Let a ball of `radius_px` roll over unlabelled, unblocked pixels; each area it can reach becomes a region.

    Args:
        labels: int32 (h, w), 0 = unlabelled; changed in place.
        blocked: uint8 (h, w), non-zero on edges.
        pixels: int32, flat indices of every unlabelled pixel, in raster order (others among them do no harm).
        radius_px: ball radius, px, >= 1.
        first_label: label of the first new region; the next ones count up.

    Returns:
        How many regions were made.

    A ball at a centre covers the disc around it; centres are the pixels whose disc holds no obstacle, so a gap
    in an edge narrower than the ball lets nothing through. The frame's border is no obstacle. Centres that touch
    (4-neighbours) are one region; where discs of two regions overlap, the first in raster order has the pixel.
    """
    sparse = radius_px <= SPARSE_UP_TO_PX and pixels.size < SPARSE * labels.size
    if radius_px <= TAPPED_UP_TO_PX or sparse:
        return fill_small(labels, blocked, pixels, radius_px, first_label)
    return _fill_large(labels, ((labels == 0) & (blocked == 0)).view(np.uint8), radius_px, first_label)


@kernel
def _disc(radius_px: int) -> NDArray[np.int64]:
    """Offsets (dy, dx) of the pixels of a ball."""
    disc = np.empty(((2 * radius_px + 1) ** 2, 2), np.int64)
    count = 0
    for dy in range(-radius_px, radius_px + 1):
        for dx in range(-radius_px, radius_px + 1):
            if dx * dx + dy * dy <= radius_px * radius_px + radius_px // 2:
                disc[count, 0], disc[count, 1] = dy, dx
                count += 1
    return disc[:count]


@kernel
def fill_small(
    labels: Labels, blocked: NDArray[np.uint8], pixels: NDArray[np.int32], radius_px: int, first_label: int
) -> int:  # fmt: skip
    """`fill` for a small ball: its disc is tried at every free pixel."""
    disc = _disc(radius_px)
    height, width = labels.shape
    free = np.zeros(labels.shape, np.uint8)  # 1 = free, 2 = a centre, 3 = a centre of a known region
    for k in range(pixels.size):
        y, x = pixels[k] // width, pixels[k] % width
        free[y, x] = labels[y, x] == 0 and blocked[y, x] == 0
    for k in range(pixels.size):
        y, x = pixels[k] // width, pixels[k] % width
        if not free[y, x]:
            continue
        fits = True
        for n in range(disc.shape[0]):
            j, i = y + disc[n, 0], x + disc[n, 1]
            if 0 <= j < height and 0 <= i < width and not free[j, i]:
                fits = False
                break
        if fits:
            free[y, x] = 2
    stack = np.empty(pixels.size, np.int32)
    made = 0
    for k in range(pixels.size):
        y, x = pixels[k] // width, pixels[k] % width
        if free[y, x] != 2:
            continue
        label = first_label + made
        made += 1
        free[y, x] = 3
        stack[0], depth = pixels[k], 1
        while depth:
            depth -= 1
            y, x = stack[depth] // width, stack[depth] % width
            for n in range(disc.shape[0]):
                j, i = y + disc[n, 0], x + disc[n, 1]
                if j < 0 or i < 0 or j >= height or i >= width:
                    continue
                if labels[j, i] == 0:
                    labels[j, i] = label
                if abs(disc[n, 0]) + abs(disc[n, 1]) == 1 and free[j, i] == 2:
                    free[j, i] = 3
                    stack[depth] = j * width + i
                    depth += 1
    return made


def _fill_large(labels: Labels, free: NDArray[np.uint8], radius_px: int, first_label: int) -> int:
    """A large ball: distance transforms say where its centre may be, and which core covers a pixel."""
    centres = np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, 5) > radius_px, np.uint8)
    count, cores = cv2.connectedComponents(centres, connectivity=4, ltype=cv2.CV_32S)
    if count == 1:
        return 0
    distance, nearest = cv2.distanceTransformWithLabels(1 - centres, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    core_of = np.zeros(int(nearest.max()) + 1, np.int32)
    at_core = centres > 0
    core_of[nearest[at_core]] = cores[at_core]
    reached = (free > 0) & (distance <= radius_px)
    labels[reached] = core_of[nearest[reached]] + np.int32(first_label - 1)
    return count - 1
