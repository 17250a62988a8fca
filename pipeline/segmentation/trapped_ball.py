"""Trapped-ball filling: zhang2011online, section 4.4, after zhang2009trapped."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel

SMALLEST_RADIUS_PX = 1
SMALL_RADIUS_PX = 4
"""Largest radius for which testing every disc is faster than distance transforms of the whole frame."""
SPARSE_RADIUS_PX, SPARSE = 16, 1 / 8
"""Discs are tested up to this radius if less than this share of the frame is unlabelled."""


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
    """Trapped-ball filling with one radius: each area that the ball can reach becomes a region.

    Args:
        labels: int32 (h, w), 0 = unlabelled; changed in place.
        blocked: uint8 (h, w), non-zero on edges.
        pixels: int32, flat indices of all unlabelled pixels in raster order; may contain labelled pixels.
        radius_px: ball radius, px, >= 1.
        first_label: label of the first new region; the next ones count up.

    Returns:
        Number of new regions.

    The ball's centre can be at pixels whose disc contains no obstacle, so the ball does not pass through gaps in edges
    that are narrower than it. The frame's border is no obstacle. Adjacent centres (4-neighbours) form one region, which
    covers their discs. A pixel in the discs of two regions belongs to the first in raster order; an area whose discs
    all lie in those of earlier regions is no region.
    """
    sparse = radius_px <= SPARSE_RADIUS_PX and pixels.size < SPARSE * labels.size
    if radius_px <= SMALL_RADIUS_PX or sparse:
        return fill_small(labels, blocked, pixels, radius_px, first_label)
    return _fill_large(labels, ((labels == 0) & (blocked == 0)).view(np.uint8), radius_px, first_label)


@kernel
def _disc(radius_px: int) -> NDArray[np.int64]:
    """Offsets (dy, dx) of the pixels of a disc."""
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
    """`fill` for a small radius: test the disc at every free pixel."""
    disc = _disc(radius_px)
    height, width = labels.shape
    free = np.zeros(labels.shape, np.uint8)  # 1 = free, 2 = centre, 3 = centre that belongs to a region
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
        covers = False
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
                    covers = True
                if abs(disc[n, 0]) + abs(disc[n, 1]) == 1 and free[j, i] == 2:
                    free[j, i] = 3
                    stack[depth] = j * width + i
                    depth += 1
        made += covers
    return made


def _fill_large(labels: Labels, free: NDArray[np.uint8], radius_px: int, first_label: int) -> int:
    """`fill` for a large radius: distance transforms give the possible centres, and the nearest core of each pixel."""
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
