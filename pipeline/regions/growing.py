"""Region growing with a constant colour model: zhang2011online, section 4.3."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions
from pipeline.regions.regions import Means, Sums, colour_difference, means_of, move

_BINS = 1400
_BINS_PER_UNIT = 4.0
"""Number of buckets of the queue, and buckets per CIELAB unit."""
_PIXEL, _COLUMN, _LABEL, _NEXT = range(4)
"""Columns of the queue's entries: flat index and column of the pixel, label, and next entry of the bucket."""


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
        pixels: int32, flat indices of all unlabelled pixels in raster order; may contain labelled pixels.
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
    there = labels.reshape(labels.size)
    left = np.empty(pixels.size, np.int32)
    count = 0
    for k in range(pixels.size):
        left[count] = pixels[k]
        count += there[pixels[k]] == 0
    return left[:count]


@kernel
def _grow(
    labels: Labels, lab: Lab8, blocked: NDArray[np.uint8], limit: NDArray[np.uint8], means: Means, sums: Sums,
    pixels: NDArray[np.int32], slack: np.float32,
) -> None:  # fmt: skip
    """While it is queued, a pixel has the negative label of its latest entry, so that it is not queued for that label
    again: an equal entry would come later in the same bucket, and find the pixel labelled."""
    width = labels.shape[1]
    anywhere = slack == np.float32(np.inf)
    there, colours = labels.reshape(labels.size), lab.reshape(labels.size, 3)
    closed, most = blocked.reshape(labels.size), limit.reshape(labels.size)
    entries = np.empty((4 * pixels.size, 4), np.int32)
    head = np.full(_BINS, -1, np.int32)
    tail = np.full(_BINS, -1, np.int32)
    used = 0
    around, aside = (-width, -1, 1, width), (0, -1, 1, 0)
    last_row, row = labels.size - width, 0
    for at in pixels:
        place = np.uint64(at)  # Numba would test a signed index for its sign
        if there[place] != 0 or (closed[place] and not anywhere):
            continue
        while at - row >= width:  # a division for each pixel would take longer
            row += width
        x = at - row
        inside = (at >= width, x > 0, x < width - 1, at < last_row)
        best, label = np.float32(1e9), np.int32(0)
        for n in range(4):  # only the most similar neighbour can label the pixel
            if not inside[n]:
                continue
            other = there[np.uint64(at + around[n])]
            if other <= 0 or other == label:
                continue
            error = colour_difference(colours, at, means, other)
            if error < best:
                best, label = error, other
        if label != 0 and (best <= most[place] * slack or anywhere):
            _enqueue(entries, head, tail, used, best, (at, x, label))
            used += 1
            there[place] = -label
    lowest = 0
    while lowest < _BINS:
        entry = head[lowest]
        if entry < 0:
            lowest += 1
            continue
        at, x, label, head[lowest] = entries[entry]
        place = np.uint64(at)
        if there[place] > 0:
            continue
        there[place] = label
        move(sums, colours, most, at, 0, label)
        inside = (at >= width, x > 0, x < width - 1, at < last_row)
        for n in range(4):
            if not inside[n]:
                continue
            to = at + around[n]
            target = np.uint64(to)
            known = there[target]
            if known > 0 or known == -label or (closed[target] and not anywhere):
                continue
            error = colour_difference(colours, to, means, label)
            if error <= most[target] * slack or anywhere:
                lowest = min(lowest, _enqueue(entries, head, tail, used, error, (to, x + aside[n], label)))
                used += 1
                there[target] = -label


@kernel
def _enqueue(
    entries: NDArray[np.int32], head: NDArray[np.int32], tail: NDArray[np.int32], used: int, error: np.float32,
    pixel: tuple[int, int, int | np.int32],
) -> int:  # fmt: skip
    """Append entry number `used`, with `pixel` = (flat index, column, label), to its bucket; returns the bucket."""
    bucket = min(_BINS - 1, int(error * _BINS_PER_UNIT))
    entries[used, _PIXEL], entries[used, _COLUMN], entries[used, _LABEL] = pixel
    entries[used, _NEXT] = -1
    if head[bucket] < 0:
        head[bucket] = used
    else:
        entries[tail[bucket], _NEXT] = used
    tail[bucket] = used
    return bucket
