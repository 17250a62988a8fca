"""Ink is taken off thin regions of their own colour, which it would cover: poured coffee, a red thread, a green stem.

The line response is largest inside a dark stripe, whatever its colour, so that a coloured stripe as narrow as a line
would become a black line. Regions along outlines keep their ink: their colour is a mixture of those beside them.

Departure: this is not part of zhang2011online, whose lines are drawn over everything.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel
from pipeline.lines.coherent import Ink
from pipeline.nonzero import nonzero_positions
from pipeline.segmentation.regions import Means

COVERED = (0.45, 0.6)
"""Mean ink of a region, 0..1, from which on it is taken off partly, and completely."""
CHROMA = (22.0, 34.0)
"""The same for the chroma of the region, CIELAB units."""
LIGHTNESS = (80.0, 120.0)
"""The same for its lightness, 0..255: dark stripes are lines."""
OWN_COLOUR = (16.0, 28.0)
"""The same for its distance, in a and b, from the mean colour of the regions beside it, CIELAB units."""
DARKER = (0.0, 20.0)
"""The same for its lightness below theirs, 0..255: other ink on it belongs to what is beside it."""
ALIKE = (0.2, 0.4)
"""The same for the share of its border where the region on the other side is nearer to it than `OWN_COLOUR`: outlines
of a coloured area keep their ink."""
LEAST_PX = 12
"""Smallest region, px of the label map."""
OVERHANG_PX = 2
"""Width, px of the label map, by which a line is wider than the stripe that it covers."""
_NEUTRAL = np.float32(128)
"""a and b of gray in 8-bit CIELAB."""


def spare_stripes(
    ink: Ink, drawn: Ink, labels: Labels, areas: NDArray[np.int32], means: Means
) -> Ink:  # fmt: skip
    """The ink without that on thin coloured regions: uint8, 0..255, `ink` itself if there are none.

    Args:
        ink: uint8 (h, w), of any size; drawn: the same at the size of the labels.
        labels: int32 (h', w').
        areas: int32 (labels,), px; means: float32 (labels, 3), mean colour in 8-bit CIELAB; both of each region.
    """
    inked, rows = _inked(labels, drawn, len(means))
    chroma = np.hypot(means[:, 1] - _NEUTRAL, means[:, 2] - _NEUTRAL)
    share = _between(inked / np.maximum(255 * areas, 1), COVERED)
    share *= _between(chroma, CHROMA) * _between(means[:, 0], LIGHTNESS)
    share[areas < LEAST_PX] = 0
    asked = share > 0
    if not asked.any():
        return ink
    beside, alike = _beside(labels, means, asked, int(rows[asked, 0].min()), int(rows[asked, 1].max()) + 1)
    apart = means - beside
    share *= _between(np.hypot(apart[:, 1], apart[:, 2]), OWN_COLOUR)
    share *= _between(-apart[:, 0], DARKER) * (1 - _between(alike, ALIKE))
    spared = np.rint(255 * share).astype(np.uint8)
    if not spared.any():
        return ink
    side = 2 * OVERHANG_PX + 1
    mask = np.asarray(cv2.dilate(spared[labels], np.ones((side, side), np.uint8)), np.uint8)
    left = ink.copy()
    _take_off(left, mask)
    return left


def _between(values: NDArray[np.floating], limits: tuple[float, float]) -> NDArray[np.floating]:
    """0 up to the lower limit, rising to 1 at the upper one."""
    return np.asarray(np.clip((values - limits[0]) / (limits[1] - limits[0]), 0, 1))


@kernel
def _inked(labels: Labels, drawn: Ink, count: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Sum of the ink of each region, and the first and the last row with ink in it, (count, 2)."""
    sums, rows = np.zeros(count, np.int64), np.zeros((count, 2), np.int32)
    places = np.empty(labels.shape[1], np.int32)
    for y in range(len(labels)):
        for x in places[: nonzero_positions(drawn[y], places)]:
            label = labels[y, x]
            if sums[label] == 0:
                rows[label, 0] = y
            rows[label, 1] = y
            sums[label] += drawn[y, x]
    return sums, rows


@kernel
def _take_off(ink: Ink, mask: NDArray[np.uint8]) -> None:
    """Reduce the ink, in place, by the mask, uint8 (h', w') of any size: 255 = completely."""
    height, width = ink.shape
    columns, places = np.empty(width, np.int32), np.empty(width, np.int32)
    for x in range(width):
        columns[x] = x * mask.shape[1] // width
    for y in range(height):
        row = mask[y * len(mask) // height]
        for x in places[: nonzero_positions(ink[y], places)]:
            ink[y, x] = (np.int32(ink[y, x]) * (255 - np.int32(row[columns[x]])) + 127) // 255


@kernel
def _beside(
    labels: Labels, means: Means, asked: NDArray[np.bool_], top: int, bottom: int
) -> tuple[Means, NDArray[np.float32]]:
    """The regions beside a region, in rows [top, bottom): their mean colour, weighted by the length of the borders,
    and the share of its border, 0..1, with regions of about its own (a, b).

    Both are 0 for regions that are not asked for. Borders between regions that are do not count: a stripe may consist
    of several.
    """
    height, width = labels.shape
    colours, alike = np.zeros((len(means), 3), np.float32), np.zeros(len(means), np.float32)
    lengths = np.zeros(len(means), np.float32)
    least = np.float32(OWN_COLOUR[0])
    for y in range(top, bottom):
        for x in range(width):
            own = labels[y, x]
            if not asked[own]:
                continue
            for j, i in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
                if 0 <= j < height and 0 <= i < width and not asked[labels[j, i]]:
                    other = means[labels[j, i]]
                    for c in range(3):
                        colours[own, c] += other[c]
                    lengths[own] += np.float32(1)
                    alike[own] += np.hypot(other[1] - means[own, 1], other[2] - means[own, 2]) < least
    for label in range(len(means)):
        most = max(lengths[label], np.float32(1))
        alike[label] /= most
        for c in range(3):
            colours[label, c] /= most
    return colours, alike
