"""Region growing with a constant colour model: zhang2011online, section 4.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.segmentation.jit import kernel
from pipeline.segmentation.regions import Lab8, Means, Sums, colour_difference, means_of, move

NO_LIMIT = 255
_BINS = 1400
_BINS_PER_UNIT = 4.0


@kernel
def unlabelled(labels: Labels) -> NDArray[np.int32]:
    """Flat indices, int32, of the pixels without a label, in raster order."""
    height, width = labels.shape
    found = np.empty(labels.size, np.int32)
    count = 0
    for y in range(height):
        for x in range(width):
            found[count] = y * width + x  # the next one overwrites it unless it counts
            count += labels[y, x] == 0
    return found[:count]


@kernel
def count_open(pixels: NDArray[np.int32], blocked: NDArray[np.uint8]) -> int:
    """How many of `pixels` (flat indices) are not blocked."""
    shut = blocked.reshape(blocked.size)
    count = 0
    for k in range(pixels.size):
        count += shut[pixels[k]] == 0
    return count


@kernel
def grow(
    labels: Labels, lab: Lab8, blocked: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
    pixels: NDArray[np.int32], anything: bool = False,
) -> NDArray[np.int32]:  # fmt: skip
    """Give unlabelled pixels the label of the neighbouring region that predicts them best; in place.

    Args:
        labels: int32 (h, w), 0 = unlabelled, C-contiguous.
        lab: uint8 (h, w, 3).
        blocked: uint8 (h, w), non-zero where no region may grow (edges).
        limit: uint8 (h, w), largest reconstruction error allowed, CIELAB units: 20 (1.2 - I(p)).
        sums: of every region; kept up to date. The colour model is that at the call.
        pixels: int32, flat indices of every unlabelled pixel (others among them do no harm).
        anything: ignore `blocked` and `limit`, for the leftovers at the end.

    Returns:
        The pixels that are still unlabelled.

    The priority queue is a bucket queue of quarter units, first in first out within a bucket: deterministic.
    """
    if not pixels.size:
        return pixels
    _grow(labels, lab, blocked, limit, means_of(sums), sums, pixels, anything)
    return _left(labels, pixels)


@kernel
def _left(labels: Labels, pixels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Those of `pixels` that have no label."""
    width = labels.shape[1]
    left = np.empty(pixels.size, np.int32)
    count = 0
    for k in range(pixels.size):
        left[count] = pixels[k]
        count += labels[pixels[k] // width, pixels[k] % width] == 0
    return left[:count]


@kernel
def _grow(
    labels: Labels, lab: Lab8, blocked: NDArray[np.uint8], limit: NDArray[np.uint8], means: Means, sums: Sums,
    pixels: NDArray[np.int32], anything: bool,
) -> None:  # fmt: skip
    height, width = labels.shape
    entries = np.empty((4 * pixels.size, 4), np.int32)  # y, x, label, next in its bucket
    head = np.full(_BINS, -1, np.int32)
    tail = np.full(_BINS, -1, np.int32)
    used = 0
    step_y = (-1, 0, 0, 1)
    step_x = (0, -1, 1, 0)
    for k in range(pixels.size):
        y, x = pixels[k] // width, pixels[k] % width
        if labels[y, x] != 0 or (blocked[y, x] and not anything):
            continue
        best, label = np.float32(1e9), 0
        for n in range(4):  # only the best of a pixel's neighbours can ever win it
            j, i = y + step_y[n], x + step_x[n]
            if j < 0 or i < 0 or j >= height or i >= width or labels[j, i] == 0 or labels[j, i] == label:
                continue
            error = colour_difference(lab, y, x, means, labels[j, i])
            if error < best:
                best, label = error, labels[j, i]
        if label != 0 and (best <= limit[y, x] or anything):
            _queue(entries, head, tail, used, best, y, x, label)
            used += 1
    lowest = 0
    while lowest < _BINS:
        entry = head[lowest]
        if entry < 0:
            lowest += 1
            continue
        head[lowest] = entries[entry, 3]
        y, x, label = entries[entry, 0], entries[entry, 1], entries[entry, 2]
        if labels[y, x] != 0:
            continue
        labels[y, x] = label
        move(sums, lab, limit, y, x, 0, label)
        for n in range(4):
            j, i = y + step_y[n], x + step_x[n]
            if j < 0 or i < 0 or j >= height or i >= width or labels[j, i] != 0:
                continue
            if blocked[j, i] and not anything:
                continue
            error = colour_difference(lab, j, i, means, label)
            if error <= limit[j, i] or anything:
                lowest = min(lowest, _queue(entries, head, tail, used, error, j, i, label))
                used += 1


@kernel
def _queue(
    entries: NDArray[np.int32], head: NDArray[np.int32], tail: NDArray[np.int32], used: int, error: np.float32,
    y: int, x: int, label: int,
) -> int:  # fmt: skip
    """Put entry number `used` at the end of its bucket; returns the bucket."""
    bucket = min(_BINS - 1, int(error * _BINS_PER_UNIT))
    entries[used, 0], entries[used, 1], entries[used, 2], entries[used, 3] = y, x, label, -1
    if head[bucket] < 0:
        head[bucket] = used
    else:
        entries[tail[bucket], 3] = used
    tail[bucket] = used
    return bucket
