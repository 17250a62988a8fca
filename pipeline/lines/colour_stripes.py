"""Ink is taken off thin regions of their own colour, which it would cover: poured coffee, a red thread, a green stem.

The line response is largest inside a dark stripe, whatever its colour, so that a coloured stripe as narrow as a line
would become a black line. Regions along outlines keep their ink: their colour is a mixture of those beside them.

Departure: this is not part of zhang2011online, whose lines are drawn over everything.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel
from pipeline.lines.coherent import Ink
from pipeline.nonzero import nonzero_positions
from pipeline.segmentation.regions import Means

COVERED = (0.45, 0.6)
"""Mean ink of a region, 0..1, from which on its ink is taken off partly, and completely."""
CHROMA = (22.0, 34.0)
"""The same for the chroma of the region, CIELAB units."""
LIGHTNESS = (80.0, 120.0)
"""The same for its lightness, 0..255: dark stripes are lines."""
OWN_COLOUR = (16.0, 28.0)
"""The same for its distance, in a and b, from the mean colour of the regions beside it, CIELAB units."""
DARKER = (0.0, 20.0)
"""The same for its lightness below theirs, 0..255: other ink on it belongs to what is beside it."""
ALIKE = (0.2, 0.4)
"""Share of its border, with regions nearer to it than `OWN_COLOUR`, from which on its ink is kept partly, and
completely: it is the outline of a coloured area."""
LEAST_PX = 12
"""Smallest region, px of the label map."""
OVERHANG_PX = 2
"""Width, px of the label map, by which a line is wider than the stripe that it covers."""
Boxes = NDArray[np.int32]
"""int32 (n, 4): top, left, bottom (exclusive), right (exclusive), px."""
_NEUTRAL = np.float32(128)
"""a and b of gray in 8-bit CIELAB."""


def spare_stripes(ink: Ink, drawn: Ink, labels: Labels, areas: NDArray[np.int32], means: Means) -> tuple[Ink, Ink]:
    """`ink` and `drawn` without the ink on thin coloured regions: uint8, 0..255, the same objects if there are none.

    Args:
        ink: uint8 (h, w), of any size; drawn: the same at the size of the labels.
        labels: int32 (h', w').
        areas: int32 (labels,), px; means: float32 (labels, 3), mean colour in 8-bit CIELAB; both of each region.
    """
    chroma = np.hypot(means[:, 1] - _NEUTRAL, means[:, 2] - _NEUTRAL)
    share = _between(_inked(labels, drawn, len(means)) / np.maximum(255 * areas, 1), COVERED)
    share *= _between(chroma, CHROMA) * _between(means[:, 0], LIGHTNESS)
    share[areas < LEAST_PX] = 0
    asked = share > 0
    if not asked.any():
        return ink, drawn
    boxes = _boxes(labels, drawn, asked)
    beside, alike = _beside(labels, means, asked, boxes)
    apart = means - beside
    share *= _between(np.hypot(apart[:, 1], apart[:, 2]), OWN_COLOUR)
    share *= _between(-apart[:, 0], DARKER) * (1 - _between(alike, ALIKE))
    spared = np.rint(255 * share).astype(np.uint8)
    if not spared.any():
        return ink, drawn
    mask, left = np.zeros(labels.shape, np.uint8), (ink.copy(), drawn.copy())
    box = _mark(labels, spared, boxes, mask)
    for plane in left:
        _take_off(plane, mask, box)
    return left


def _between(values: NDArray[np.floating], limits: tuple[float, float]) -> NDArray[np.floating]:
    """0 up to the lower limit, rising to 1 at the upper one."""
    return np.asarray(np.clip((values - limits[0]) / (limits[1] - limits[0]), 0, 1))


@kernel
def _inked(labels: Labels, drawn: Ink, count: int) -> NDArray[np.int64]:
    """Sum of the ink of each region."""
    sums, places = np.zeros(count, np.int64), np.empty(labels.shape[1], np.int32)
    for y in range(len(labels)):
        row, ink = labels[y], drawn[y]
        for x in places[: nonzero_positions(ink, places)]:
            sums[row[x]] += ink[x]
    return sums


@kernel
def _boxes(labels: Labels, drawn: Ink, asked: NDArray[np.bool_]) -> Boxes:
    """The box around the inked pixels of each region that is asked for."""
    height, width = labels.shape
    boxes, places = np.zeros((len(asked), 4), np.int32), np.empty(width, np.int32)
    boxes[:, 0], boxes[:, 1] = height, width
    for y in range(height):
        for x in places[: nonzero_positions(drawn[y], places)]:
            label = labels[y, x]
            if asked[label]:
                boxes[label, 0], boxes[label, 2] = min(boxes[label, 0], y), y + 1
                boxes[label, 1], boxes[label, 3] = min(boxes[label, 1], x), max(boxes[label, 3], x + 1)
    return boxes


@kernel
def _beside(labels: Labels, means: Means, asked: NDArray[np.bool_], boxes: Boxes) -> tuple[Means, NDArray[np.float32]]:
    """The regions beside a region, in its box: their mean colour, weighted by the length of the borders, and the share
    of its border, 0..1, with regions of about its own (a, b).

    Both are 0 for regions that are not asked for. Borders between regions that are do not count: a stripe may consist
    of several.
    """
    height, width = labels.shape
    colours, alike = np.zeros((len(means), 3), np.float32), np.zeros(len(means), np.float32)
    least = np.float32(OWN_COLOUR[0])
    for own in np.nonzero(asked)[0]:
        top, left, bottom, right = boxes[own]
        length = np.float32(0)
        for y in range(top, bottom):
            for x in range(left, right):
                if labels[y, x] != own:
                    continue
                for down, across in ((0, -1), (0, 1), (-1, 0), (1, 0)):
                    j, i = y + down, x + across
                    if 0 <= j < height and 0 <= i < width and not asked[labels[j, i]]:
                        other = means[labels[j, i]]
                        for c in range(3):
                            colours[own, c] += other[c]
                        length += np.float32(1)
                        alike[own] += np.hypot(other[1] - means[own, 1], other[2] - means[own, 2]) < least
        length = max(length, np.float32(1))
        alike[own] /= length
        for c in range(3):
            colours[own, c] /= length
    return colours, alike


@kernel
def _mark(
    labels: Labels, spared: NDArray[np.uint8], boxes: Boxes, mask: NDArray[np.uint8]
) -> tuple[int, int, int, int]:
    """Write `spared` to the pixels of the regions in their boxes, and around them as far as a line may reach, where it
    is larger than before; returns the box around all of these pixels."""
    height, width = labels.shape
    first_y, first_x, last_y, last_x = height, width, 0, 0
    for own in np.nonzero(spared)[0]:
        top, left, bottom, right = boxes[own]
        for y in range(top, bottom):
            for x in range(left, right):
                if labels[y, x] != own:
                    continue
                for j in range(max(y - OVERHANG_PX, 0), min(y + OVERHANG_PX + 1, height)):
                    for i in range(max(x - OVERHANG_PX, 0), min(x + OVERHANG_PX + 1, width)):
                        mask[j, i] = max(mask[j, i], spared[own])
        first_y, last_y = min(first_y, max(top - OVERHANG_PX, 0)), max(last_y, min(bottom + OVERHANG_PX, height))
        first_x, last_x = min(first_x, max(left - OVERHANG_PX, 0)), max(last_x, min(right + OVERHANG_PX, width))
    return first_y, first_x, last_y, last_x


@kernel
def _take_off(ink: Ink, mask: NDArray[np.uint8], box: tuple[int, int, int, int]) -> None:
    """Reduce the ink in a box of the mask, in place, by the mask, uint8 (h', w') of any size: 255 = completely."""
    (height, width), (rows, columns) = ink.shape, mask.shape
    top, left, bottom, right = box
    for y in range(top * height // rows, (bottom * height + rows - 1) // rows):
        row = mask[y * rows // height]
        for x in range(left * width // columns, (right * width + columns - 1) // columns):
            if ink[y, x]:
                share = 255 - np.int32(row[x * columns // width])
                ink[y, x] = (np.int32(ink[y, x]) * share + 127) // 255
