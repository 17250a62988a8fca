"""Table of sums by region (colour, area, growing limit), updated when a pixel moves from one region to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.lab8 import Lab8
from pipeline.frames import Labels
from pipeline.kernels.jit import kernel

Means = NDArray[np.float32]
"""float32 (regions + 1, 3), mean 8-bit Lab of every region; row 0 unused."""
Sums = NDArray[np.int64]
"""int64 (regions + 1, 5): sums of L, a, b, area in px, and sum of the growing limit, see `LIGHT`. Row 0: unlabelled
pixels."""

LIGHT, A, B, AREA, LIMIT = range(5)
"""Columns of `Sums`."""


@kernel
def measure(labels: Labels, lab: Lab8, limit: NDArray[np.uint8], count: int) -> Sums:
    """Sums of the regions 0..count."""
    sums = np.zeros((count + 1, 5), np.int64)
    height, width = labels.shape
    for y in range(height):  # runs of one label are added up before they touch the table
        run = labels[y, 0]
        light = a = b = n = m = np.int64(0)
        for x in range(width):
            if labels[y, x] != run:
                sums[run, LIGHT] += light
                sums[run, A] += a
                sums[run, B] += b
                sums[run, AREA] += n
                sums[run, LIMIT] += m
                run = labels[y, x]
                light = a = b = n = m = np.int64(0)
            light += lab[y, x, 0]
            a += lab[y, x, 1]
            b += lab[y, x, 2]
            m += limit[y, x]
            n += 1
        sums[run, LIGHT] += light
        sums[run, A] += a
        sums[run, B] += b
        sums[run, AREA] += n
        sums[run, LIMIT] += m
    return sums


@kernel
def means_of(sums: Sums) -> Means:
    """Mean colours of the regions; 0 for an empty region."""
    means = np.empty((sums.shape[0], 3), np.float32)
    for label in range(sums.shape[0]):
        area = max(sums[label, AREA], 1)
        for c in range(3):
            means[label, c] = sums[label, c] / area
    return means


@kernel
def move(sums: Sums, colours: Lab8, limit: NDArray[np.uint8], at: int, old: int, new: int) -> None:
    """Move pixel `at` from region `old` to region `new`.

    Args:
        colours: uint8 (pixels, 3), CIELAB of the frame's pixels.
        limit: uint8 (pixels,), growing limit.
    """
    place, before, after = np.uint64(at), np.uint64(old), np.uint64(new)  # Numba would test a signed index for its sign
    for c in range(3):
        sums[before, c] -= colours[place, c]
        sums[after, c] += colours[place, c]
    sums[before, AREA] -= 1
    sums[after, AREA] += 1
    sums[before, LIMIT] -= limit[place]
    sums[after, LIMIT] += limit[place]


@kernel
def colour_difference(colours: Lab8, at: int, means: Means, label: int) -> np.float32:
    """CIELAB distance of a pixel to a region's mean. `colours`: uint8 (pixels, 3), CIELAB of the frame's pixels."""
    place, region = np.uint64(at), np.uint64(label)  # Numba would test a signed index for its sign
    dl = (colours[place, 0] - means[region, 0]) * np.float32(100.0 / 255.0)
    da = colours[place, 1] - means[region, 1]
    db = colours[place, 2] - means[region, 2]
    return np.float32(np.sqrt(dl * dl + da * da + db * db))


@kernel
def merge(sums: Sums, table: NDArray[np.int32]) -> tuple[Sums, NDArray[np.int32], NDArray[np.int32]]:
    """Merge each region into region `table[label]`, and number the remaining ones without gaps.

    Returns: sums of the remaining regions; int32, new label by old label; int32, old label by new label.
    """
    count = sums.shape[0]
    merged = np.zeros_like(sums)
    for label in range(count):
        for c in range(sums.shape[1]):
            merged[table[label], c] += sums[label, c]
    names = np.zeros(count, np.int32)
    old = np.zeros(count, np.int32)
    used = 1
    for label in range(1, count):
        if merged[label, AREA] > 0:
            merged[used] = merged[label]
            names[label], old[used] = used, label
            used += 1
    return merged[:used], names, old[:used]


NOT_PROPAGATED: Labels = np.zeros((1, 1), np.int32)
"""Argument `propagated` of `relabel` after a cut."""


@kernel
def relabel(
    labels: Labels, names: NDArray[np.int32], propagated: Labels, kept: NDArray[np.int32], count: int
) -> NDArray[np.int32]:  # fmt: skip
    """Replace labels by names[labels], in place, and count the pixels that each region keeps from the previous frame.

    Args:
        labels: int32 (h, w).
        names: int32, new label by old label.
        propagated: int32 (h, w), labels propagated from the previous frame, or `NOT_PROPAGATED`.
        kept: int32, new label by propagated label; 0 = the region has vanished.
        count: new labels are 0..count.

    Returns: int32 (count + 1,): pixels of each region whose propagated label is this region.
    """
    arrived = np.zeros(count + 1, np.int32)
    height, width = labels.shape
    known = propagated.shape == labels.shape
    for y in range(height):
        before, came = np.int32(-1), np.int32(-1)
        name, stayed, run = np.int32(0), False, np.int32(0)
        for x in range(width):  # runs of one label and one origin, as in `measure`
            origin = propagated[y, x] if known else np.int32(0)
            if labels[y, x] != before or origin != came:
                arrived[name] += run
                before, came, run = labels[y, x], origin, np.int32(0)
                name = names[before]
                stayed = came != 0 and kept[came] == name
            labels[y, x] = name
            run += stayed
        arrived[name] += run
    return arrived


@kernel
def carried(
    labels: Labels, propagated: Labels, colours: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Mean of what the pixels of each region had in the previous frame, and the share of its pixels that had it.

    Args:
        labels: int32 (h, w), 0..regions.
        propagated: int32 (h, w), labels of the previous frame moved to this one, 0 = none; or `NOT_PROPAGATED`.
        colours: float64 (previous regions + 1, columns), by label of the previous frame.

    Returns: float64 (regions + 1, columns), 0 where no pixel was known; and float64 (regions + 1,), 0..1.
    """
    count, columns = 1, colours.shape[1]
    for row in labels:
        for label in row:
            count = max(count, label + 1)
    sums, known, areas = np.zeros((count, columns)), np.zeros(count), np.zeros(count)
    if propagated.shape != labels.shape:
        return sums, known
    height, width = labels.shape
    for y in range(height):
        label, origin, run = labels[y, 0], propagated[y, 0], 0
        for x in range(width + 1):  # runs of one label and one origin
            if x == width or labels[y, x] != label or propagated[y, x] != origin:
                areas[label] += run
                if origin > 0:
                    known[label] += run
                    for c in range(columns):
                        sums[label, c] += run * colours[origin, c]
                if x == width:
                    break
                label, origin, run = labels[y, x], propagated[y, x], 0
            run += 1
    for label in range(count):
        for c in range(columns):
            sums[label, c] /= max(known[label], 1.0)
        known[label] /= max(areas[label], 1.0)
    return sums, known
