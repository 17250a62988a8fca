"""Region growing with a constant colour model: zhang2011online, section 4.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel
from pipeline.nonzero import nonzero_positions
from pipeline.segmentation.regions import Lab8, Means, Sums, means_of, move

_BINS = 1400
_BINS_PER_UNIT = 4.0
"""Number of buckets of the queue, and buckets per CIELAB unit."""
_PIXEL, _LABEL, _NEXT = range(3)
"""Columns of the queue's entries: flat index, label, and next entry of the bucket."""


@kernel
def unlabelled(labels: Labels) -> NDArray[np.int32]:
    """Flat indices of the unlabelled pixels in raster order, int32 (n,)."""
    height, width = labels.shape
    found, flags = np.empty(labels.size, np.int32), np.empty(width, np.uint8)
    count = 0
    for y in range(height):
        row = labels[y]
        for x in range(width):  # this vectorises
            flags[x] = np.uint8(row[x] == 0)
        count = nonzero_positions(flags, found, y * width, count)
    return found[:count]


@kernel
def count_open(pixels: NDArray[np.int32], blocked: NDArray[np.uint8]) -> int:
    """Number of `pixels` (flat indices) that are not blocked."""
    closed = blocked.reshape(blocked.size)
    count = 0
    for k in range(pixels.size):
        count += closed[pixels[k]] == 0
    return count


@kernel
def grow(
    labels: Labels, lab: Lab8, blocked: NDArray[np.uint8], limit: NDArray[np.uint8], sums: Sums,
    pixels: NDArray[np.int32], slack: float = 1.0,
) -> NDArray[np.int32]:  # fmt: skip
    """Give unlabelled pixels the label of the neighbouring region with the most similar colour, in place.

    Args:
        labels: int32 (h, w), 0 = unlabelled, C-contiguous.
        lab: uint8 (h, w, 3).
        blocked: uint8 (h, w), non-zero where no region may grow (edges).
        limit: uint8 (h, w), largest reconstruction error allowed, CIELAB units: 20 (1.2 - I(p)).
        sums: sums of the regions, updated. Colours are compared with the means at the time of the call.
        pixels: int32, flat indices of all unlabelled pixels; may contain labelled pixels.
        slack: factor on `limit`; infinity ignores `blocked` too, for the remaining pixels at the end.

    Returns:
        Flat indices of the pixels that are still unlabelled.

    The priority queue has buckets of a quarter CIELAB unit, first in first out within a bucket, so the result is
    deterministic.
    """
    if not pixels.size:
        return pixels
    _grow(labels, lab, blocked, limit, means_of(sums), sums, pixels, np.float32(slack))
    return _still_unlabelled(labels, pixels)


@kernel
def _still_unlabelled(labels: Labels, pixels: NDArray[np.int32]) -> NDArray[np.int32]:
    """The unlabelled ones of `pixels`."""
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
    pixels: NDArray[np.int32], slack: np.float32,
) -> None:  # fmt: skip
    width = labels.shape[1]
    anywhere = slack == np.float32(np.inf)
    there, colours = labels.reshape(labels.size), lab.reshape(labels.size, 3)
    closed, most = blocked.reshape(labels.size), limit.reshape(labels.size)
    entries = np.empty((4 * pixels.size, 3), np.int32)
    head = np.full(_BINS, -1, np.int32)
    tail = np.full(_BINS, -1, np.int32)
    used = 0
    around = (-width, -1, 1, width)
    last_row = labels.size - width
    for at in pixels:
        if there[at] != 0 or (closed[at] and not anywhere):
            continue
        x = at % width
        inside = (at >= width, x > 0, x < width - 1, at < last_row)
        best, label = np.float32(1e9), np.int32(0)
        for n in range(4):  # only the most similar neighbour can label the pixel
            if not inside[n]:
                continue
            other = there[at + around[n]]
            if other == 0 or other == label:
                continue
            error = _colour_distance(colours, at, means, other)
            if error < best:
                best, label = error, other
        if label != 0 and (best <= most[at] * slack or anywhere):
            _enqueue(entries, head, tail, used, best, at, label)
            used += 1
    lowest = 0
    while lowest < _BINS:
        entry = head[lowest]
        if entry < 0:
            lowest += 1
            continue
        at, label, head[lowest] = entries[entry, _PIXEL], entries[entry, _LABEL], entries[entry, _NEXT]
        if there[at] != 0:
            continue
        there[at] = label
        y, x = at // width, at % width
        move(sums, lab, limit, y, x, 0, label)
        inside = (at >= width, x > 0, x < width - 1, at < last_row)
        for n in range(4):
            to = at + around[n]
            if not inside[n] or there[to] != 0 or (closed[to] and not anywhere):
                continue
            error = _colour_distance(colours, to, means, label)
            if error <= most[to] * slack or anywhere:
                lowest = min(lowest, _enqueue(entries, head, tail, used, error, to, label))
                used += 1


@kernel
def _colour_distance(colours: NDArray[np.uint8], at: int, means: Means, label: int | np.int32) -> np.float32:
    """CIELAB distance of a pixel to a region's mean."""
    dl = (colours[at, 0] - means[label, 0]) * np.float32(100.0 / 255.0)
    da = colours[at, 1] - means[label, 1]
    db = colours[at, 2] - means[label, 2]
    return np.float32(np.sqrt(dl * dl + da * da + db * db))


@kernel
def _enqueue(
    entries: NDArray[np.int32], head: NDArray[np.int32], tail: NDArray[np.int32], used: int, error: np.float32,
    at: int, label: int | np.int32,
) -> int:  # fmt: skip
    """Append entry number `used` to its bucket; returns the bucket."""
    bucket = min(_BINS - 1, int(error * _BINS_PER_UNIT))
    entries[used, _PIXEL], entries[used, _LABEL], entries[used, _NEXT] = at, label, -1
    if head[bucket] < 0:
        head[bucket] = used
    else:
        entries[tail[bucket], _NEXT] = used
    tail[bucket] = used
    return bucket
