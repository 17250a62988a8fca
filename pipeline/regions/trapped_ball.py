"""Trapped-ball filling: zhang2011online, section 4.4, after zhang2009trapped."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.kernels.jit import kernel

SMALLEST_RADIUS_PX = 1
SMALL_RADIUS_PX = 4
"""Largest radius for which testing every disc is faster than distance transforms of the whole frame."""
SPARSE = 1 / 8
"""Discs are tested with any radius if less than this share of the frame is unlabelled."""


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
    if radius_px <= SMALL_RADIUS_PX or pixels.size < SPARSE * labels.size:
        return fill_small(labels, blocked, pixels, radius_px, first_label)
    return _fill_large(labels, ((labels == 0) & (blocked == 0)).view(np.uint8), radius_px, first_label)


@kernel
def _half_widths(radius_px: int) -> NDArray[np.int64]:
    """A disc by its rows: pixels on each side of the middle column, for the rows -radius_px..radius_px."""
    widths = np.zeros(2 * radius_px + 1, np.int64)
    for dy in range(-radius_px, radius_px + 1):
        while (widths[dy + radius_px] + 1) ** 2 + dy * dy <= radius_px * radius_px + radius_px // 2:
            widths[dy + radius_px] += 1
    return widths


@kernel
def fill_small(
    labels: Labels, blocked: NDArray[np.uint8], pixels: NDArray[np.int32], radius_px: int, first_label: int
) -> int:  # fmt: skip
    """`fill` without a pass over the whole frame: tests the rows of the disc at every free pixel."""
    widths = _half_widths(radius_px)
    state = np.zeros(labels.shape, np.uint8)  # 1 = free, 2 = centre, 3 = centre that belongs to a region
    there, closed, states = labels.reshape(labels.size), blocked.reshape(labels.size), state.reshape(labels.size)
    for at in pixels.view(np.uint32):  # Numba would test a signed index for its sign
        states[at] = there[at] == 0 and closed[at] == 0
    _find_centres(states, _reach(state, pixels), labels.shape[1], pixels, widths)
    members = np.empty(pixels.size, np.int32)
    made = 0
    for at in pixels:
        if states[at] == 2:
            count = _connected(state, at, members)
            made += _cover(labels, state, members[:count], widths, first_label + made)
    return made


@kernel
def _reach(state: NDArray[np.uint8], pixels: NDArray[np.int32]) -> NDArray[np.uint16]:
    """Number of free pixels from a free pixel, itself included, to the nearer obstacle in its row: uint16 (h * w,).

    The frame's border is no obstacle.
    """
    width = state.shape[1]
    flat, reach = state.reshape(state.size), np.zeros(state.size, np.uint16)
    far = 65535
    row = 0
    for at in pixels.view(np.uint32):  # Numba would test a signed index for its sign
        while at - row >= width:  # a division for each pixel would take longer
            row += width
        if flat[at]:
            before = far if at == row else int(reach[np.uint64(at - 1)])
            reach[at] = min(before + 1, far) if before else 1
    run = far
    for k in range(pixels.size - 1, -1, -1):
        at = np.uint32(pixels[k])
        while at < row:
            row -= width
        if flat[at]:
            last = at == row + width - 1
            run = far if last else (min(run + 1, far) if flat[np.uint64(at + 1)] else 1)
            reach[at] = min(int(reach[at]), run)
    return reach


@kernel
def _find_centres(
    states: NDArray[np.uint8], reach: NDArray[np.uint16], width: int, pixels: NDArray[np.int32],
    widths: NDArray[np.int64],
) -> None:  # fmt: skip
    """Mark the free pixels whose disc contains no obstacle as 2. Pixels outside the frame are no obstacles."""
    radius = widths.size // 2
    for at in pixels.view(np.uint32):  # as in `_reach`
        if states[at] == 0:
            continue
        fits = True
        for n in range(widths.size):
            to = at + (n - radius) * width
            if 0 <= to < states.size and reach[np.uint64(to)] <= widths[n]:
                fits = False
                break
        if fits:
            states[at] = 2


@kernel
def _connected(state: NDArray[np.uint8], start: int, members: NDArray[np.int32]) -> int:
    """Mark the centres that are connected to `start` as 3, and write their flat indices; returns their number."""
    height, width = state.shape
    state[start // width, start % width] = 3
    members[0], count, done = start, 1, 0
    while done < count:
        y, x = members[done] // width, members[done] % width
        done += 1
        for j, i in ((y - 1, x), (y, x - 1), (y, x + 1), (y + 1, x)):
            if 0 <= j < height and 0 <= i < width and state[j, i] == 2:
                state[j, i] = 3
                members[count] = j * width + i
                count += 1
    return count


@kernel
def _cover(
    labels: Labels, state: NDArray[np.uint8], centres: NDArray[np.int32], widths: NDArray[np.int64], label: int
) -> bool:
    """Label the pixels that the discs of connected centres cover and no earlier region covers; False if there are
    none."""
    height, width = labels.shape
    radius, covers = widths.size // 2, False
    for at in centres:
        y, first = at // width, at % width
        if first > 0 and state[y, first - 1] == 3:
            continue  # the centres of a row that follow each other are drawn together
        last = first
        while last + 1 < width and state[y, last + 1] == 3:
            last += 1
        for n in range(widths.size):
            row = y + n - radius
            if 0 <= row < height:
                there = labels[row]
                for x in range(max(first - widths[n], 0), min(last + widths[n] + 1, width)):
                    if there[x] == 0:
                        there[x] = label
                        covers = True
    return covers


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
