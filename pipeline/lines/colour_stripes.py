"""Removes ink from thin coloured regions that it would cover: poured coffee, a red thread, a green stem.

The line response is largest inside a dark stripe, whatever its colour, so that a coloured stripe as narrow as a line
would become a black line. Regions along outlines keep their ink: their colour is a mixture of those beside them.

Departure: this is not part of zhang2011online, whose lines are drawn over everything.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions
from pipeline.lines.coherent import Ink
from pipeline.regions.regions import Means


class StripeParams(NamedTuple):
    """Constants of the choice of stripes: ranges in which the share of removed ink rises from 0 to 1, or falls."""

    covered: tuple[float, float] = (0.45, 0.6)
    """Mean ink of a region, 0..1: up to the first value its ink is kept, from the second one on all of it is
    removed."""
    chroma: tuple[float, float] = (22.0, 34.0)
    """The same for the chroma of the region, CIELAB units."""
    lightness: tuple[float, float] = (80.0, 120.0)
    """The same for its lightness, 0..255: dark stripes stay lines."""
    hue_distance: tuple[float, float] = (16.0, 28.0)
    """The same for the distance, in a and b, of its colour from the mean colour of its neighbours, CIELAB units."""
    darker: tuple[float, float] = (0.0, 20.0)
    """The same for the difference by which its neighbours are lighter, 0..255. If they are darker, the line is
    theirs."""
    similar_border: tuple[float, float] = (0.2, 0.4)
    """Share of a region's border with neighbours nearer than the first `hue_distance`: up to the first value ink is
    removed, from the second one on it is kept, because the region is the outline of a coloured area."""
    least_px: int = 12
    """Smallest region from which ink is removed, px of the label map."""
    overhang_px: int = 2
    """Width, px of the label map, by which a line extends beyond the stripe that it covers."""


STRIPES = StripeParams()


Boxes = NDArray[np.int32]
"""int32 (n, 4): top, left, bottom (exclusive), right (exclusive), px."""
_NEUTRAL = np.float32(128)
"""a and b of gray in 8-bit CIELAB."""


def erase_ink_on_thin_regions(
    ink: Ink, drawn: Ink, labels: Labels, areas: NDArray[np.int32], means: Means
) -> tuple[Ink, Ink]:
    """`ink` and `drawn` without the ink on thin coloured regions: uint8, 0..255, the same objects if there are none.

    Args:
        ink: uint8 (h, w), of any size; drawn: the same at the size of the labels.
        labels: int32 (h', w').
        areas: int32 (labels,), px; means: float32 (labels, 3), mean colour in 8-bit CIELAB; both of each region.
    """
    removed, boxes = np.zeros(len(means), np.uint8), np.empty((len(means), 4), np.int32)
    if not _find_stripes(labels, drawn, areas, means, removed, boxes):
        return ink, drawn
    mask = np.zeros(labels.shape, np.uint8)
    box = _mark(labels, removed, boxes, mask)
    rest = _reduced(ink, mask, box)
    return rest, rest if drawn is ink else _reduced(drawn, mask, box)


def _reduced(ink: Ink, mask: NDArray[np.uint8], box: tuple[int, int, int, int]) -> Ink:
    """A copy of the ink, reduced by the mask in a box of it."""
    rest = ink.copy()
    _reduce(rest, mask, box)
    return rest


@kernel
def _find_stripes(
    labels: Labels, drawn: Ink, areas: NDArray[np.int32], means: Means, removed: NDArray[np.uint8], boxes: Boxes
) -> bool:  # fmt: skip
    """Write the share of the ink that each region loses, 255 = all, to `removed`, which is 0 everywhere, and the boxes
    of these regions. Returns whether there are any."""
    share, candidates = np.zeros(len(means), np.float64), np.zeros(len(means), np.bool_)
    inked = _inked(labels, drawn, len(means))
    for own in range(len(means)):
        if areas[own] >= STRIPES.least_px:
            share[own] = (
                _between(inked[own] / (255.0 * areas[own]), STRIPES.covered)
                * _between(_chroma(means[own], _NEUTRAL, _NEUTRAL), STRIPES.chroma)
                * _between(means[own, 0], STRIPES.lightness)
            )
            candidates[own] = share[own] > 0
    stripes = np.nonzero(candidates)[0]
    if not stripes.size:
        return False
    boxes[:] = _boxes(labels, drawn, candidates)
    neighbours, similar = _neighbours(labels, means, candidates, boxes)
    found = False
    for stripe in stripes:
        own, beside = int(stripe), neighbours[stripe]
        share[own] *= (
            _between(_chroma(means[own], beside[1], beside[2]), STRIPES.hue_distance)
            * _between(beside[0] - means[own, 0], STRIPES.darker)
            * (1.0 - _between(similar[own], STRIPES.similar_border))
        )
        removed[own] = np.uint8(np.rint(255 * share[own]))
        found |= removed[own] > 0
    return found


@kernel
def _between(value: float | np.float32, limits: tuple[float, float]) -> float:
    """0 up to the lower limit, rising to 1 at the upper one."""
    return float(min(max((value - limits[0]) / (limits[1] - limits[0]), 0.0), 1.0))


@kernel
def _chroma(colour: NDArray[np.float32], a: np.float32, b: np.float32) -> np.float32:
    """Distance of a colour from (a, b) in the plane of a and b."""
    across, down = colour[1] - a, colour[2] - b
    return np.float32(np.sqrt(across * across + down * down))


@kernel
def _inked(labels: Labels, drawn: Ink, count: int) -> NDArray[np.int64]:
    """Sum of the ink of each region."""
    sums, places = np.zeros(count, np.int64), np.empty(labels.shape[1], np.int32)
    for y in range(len(labels)):
        row, ink = labels[y], drawn[y]
        for x in places[: nonzero_positions(ink, places)]:
            at = np.uint64(x)  # Numba would test a signed index for its sign
            sums[np.uint64(row[at])] += ink[at]
    return sums


@kernel
def _boxes(labels: Labels, drawn: Ink, candidates: NDArray[np.bool_]) -> Boxes:
    """The box around the inked pixels of each candidate."""
    height, width = labels.shape
    boxes, places = np.zeros((len(candidates), 4), np.int32), np.empty(width, np.int32)
    boxes[:, 0], boxes[:, 1] = height, width
    for y in range(height):
        for x in places[: nonzero_positions(drawn[y], places)]:
            label = labels[y, x]
            if candidates[label]:
                boxes[label, 0], boxes[label, 2] = min(boxes[label, 0], y), y + 1
                boxes[label, 1], boxes[label, 3] = min(boxes[label, 1], x), max(boxes[label, 3], x + 1)
    return boxes


@kernel
def _neighbours(
    labels: Labels, means: Means, candidates: NDArray[np.bool_], boxes: Boxes
) -> tuple[Means, NDArray[np.float32]]:
    """Mean colour of the neighbours of each candidate in its box, float32 (labels, 3), weighted by the length of the
    borders; and the share of its border, 0..1, with neighbours of a similar (a, b), float32 (labels,).

    Both are 0 for other regions. Other candidates are no neighbours, because a stripe may consist of several regions.
    """
    height, width = labels.shape
    colours, similar = np.zeros((len(means), 3), np.float32), np.zeros(len(means), np.float32)
    least = np.float32(STRIPES.hue_distance[0])
    for own in np.nonzero(candidates)[0]:
        top, left, bottom, right = boxes[own]
        length = np.float32(0)
        for y in range(top, bottom):
            for x in range(left, right):
                if labels[y, x] != own:
                    continue
                for down, across in ((0, -1), (0, 1), (-1, 0), (1, 0)):
                    j, i = y + down, x + across
                    if 0 <= j < height and 0 <= i < width and not candidates[labels[j, i]]:
                        other = means[labels[j, i]]
                        for c in range(3):
                            colours[own, c] += other[c]
                        length += np.float32(1)
                        a, b = other[1] - means[own, 1], other[2] - means[own, 2]
                        similar[own] += a * a + b * b < least * least
        length = max(length, np.float32(1))
        similar[own] /= length
        for c in range(3):
            colours[own, c] /= length
    return colours, similar


@kernel
def _mark(
    labels: Labels, removed: NDArray[np.uint8], boxes: Boxes, mask: NDArray[np.uint8]
) -> tuple[int, int, int, int]:
    """Raise the mask to `removed` at the pixels of the regions in their boxes, and up to `STRIPES.overhang_px` around
    them.

    Returns: the box around all of these pixels.
    """
    height, width = labels.shape
    first_y, first_x, last_y, last_x = height, width, 0, 0
    for own in np.nonzero(removed)[0]:
        top, left, bottom, right = boxes[own]
        for y in range(top, bottom):
            for x in range(left, right):
                if labels[y, x] != own:
                    continue
                for j in range(max(y - STRIPES.overhang_px, 0), min(y + STRIPES.overhang_px + 1, height)):
                    for i in range(max(x - STRIPES.overhang_px, 0), min(x + STRIPES.overhang_px + 1, width)):
                        mask[j, i] = max(mask[j, i], removed[own])
        first_y, last_y = (
            min(first_y, max(top - STRIPES.overhang_px, 0)),
            max(last_y, min(bottom + STRIPES.overhang_px, height)),
        )
        first_x, last_x = (
            min(first_x, max(left - STRIPES.overhang_px, 0)),
            max(last_x, min(right + STRIPES.overhang_px, width)),
        )
    return first_y, first_x, last_y, last_x


@kernel
def _reduce(ink: Ink, mask: NDArray[np.uint8], box: tuple[int, int, int, int]) -> None:
    """Reduce the ink in a box of the mask, in place, by the mask, uint8 (h', w') of any size: 255 = completely."""
    (height, width), (rows, columns) = ink.shape, mask.shape
    top, left, bottom, right = box
    for y in range(top * height // rows, (bottom * height + rows - 1) // rows):
        row = mask[y * rows // height]
        for x in range(left * width // columns, (right * width + columns - 1) // columns):
            if ink[y, x]:
                share = 255 - np.int32(row[x * columns // width])
                ink[y, x] = (np.int32(ink[y, x]) * share + 127) // 255
