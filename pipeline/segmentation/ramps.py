"""Thin regions of intermediate colour along blurred edges are divided between the two regions beside them.

An edge in a video is several pixels wide, and its pixels are mixtures of the colours on both sides. Segmentation makes
thin regions of them, so that an edge is drawn as a staircase of two or three small steps. Here each row and each column
of such a region is divided between its two neighbours, in proportion to the mixture: the border then lies where a sharp
edge of the same mean colour would lie. Thin regions of a colour that is no mixture, such as a lip or a wire, are kept.

Departure: this is not part of zhang2011online, whose frames have 352 x 288 px.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel
from pipeline.nonzero import nonzero_positions
from pipeline.segmentation.regions import Means

_LONGEST_CHAIN = 3
"""Largest total extent of adjacent thin regions that are divided together, relative to that of one region."""
_LEAST_SHARE = np.float32(0.06)
"""A mixture has at least this share of either colour; otherwise the region is one of the two itself."""
_LARGEST_DEVIATION = np.float32(0.3)
"""Largest distance of a mixture from the straight line between the two colours, relative to their distance."""


def divide_ramps(labels: Labels, means: Means, widest_px: int) -> Labels:
    """Label map without thin regions of intermediate colour, int32 (h, w); regions keep their labels.

    Args:
        labels: int32 (h, w).
        means: float32 (labels, 3), mean colour of each region in 8-bit CIELAB.
        widest_px: largest extent of a divided row or column of a region, px; regions side by side that are mixtures of
            the same two colours may have three times that extent together. 0 returns `labels` itself.
    """
    if widest_px <= 0:
        return labels
    out, lengths = labels.copy(), np.full(labels.shape, 255, np.uint8)
    widest_px = min(widest_px, 254 // _LONGEST_CHAIN)
    _divide_rows(labels, means, widest_px, out, lengths)
    _divide_columns(labels, means, widest_px, out, lengths)
    _remove_ticks(out, lengths)
    return out


@kernel
def _remove_ticks(out: Labels, lengths: NDArray[np.uint8]) -> None:
    """Undivided pixels between two divided ones of the same label take that label. Otherwise a row or column whose
    colour is not quite a mixture would protrude from the border."""
    height, width = out.shape
    between, places = np.zeros(width, np.uint8), np.empty(width, np.int32)
    for y in range(1, height - 1):
        row, above, below = out[y], out[y - 1], out[y + 1]
        here, over, under = lengths[y], lengths[y - 1], lengths[y + 1]
        for x in range(1, width - 1):  # this vectorises
            inside = (max(here[x - 1], here[x + 1]) < 255) | (max(over[x], under[x]) < 255)
            between[x] = np.uint8((here[x] == 255) & inside)
        for x in places[: nonzero_positions(between, places)]:
            across = max(lengths[y, x - 1], lengths[y, x + 1]) < 255 and row[x - 1] == row[x + 1]
            along = max(lengths[y - 1, x], lengths[y + 1, x]) < 255 and above[x] == below[x]
            if across:
                row[x] = row[x - 1]
            elif along:
                row[x] = above[x]


@kernel
def _divide_rows(labels: Labels, means: Means, widest: int, out: Labels, lengths: NDArray[np.uint8]) -> None:
    """Divide the thin regions of each row; `lengths` receives the total extent of adjacent divided regions."""
    height, width = labels.shape
    changes, places = np.zeros(width, np.uint8), np.empty(width + 1, np.int32)
    for y in range(height):
        row = labels[y]
        for x in range(1, width):  # this vectorises
            changes[x] = row[x] != row[x - 1]
        count = nonzero_positions(changes, places)
        start = 0  # of the run before the next change
        chain = -1  # first pixel of the thin regions since the last wide one; -1 = the row's first region
        for k in range(count):
            if chain < 0 or places[k] - start > widest:
                if 0 < chain < start:
                    _divide_chain(row, chain, start, means, widest, out[y], lengths[y])
                chain = places[k]
            start = places[k]
        if 0 < chain < start:
            _divide_chain(row, chain, start, means, widest, out[y], lengths[y])


@kernel
def _divide_columns(labels: Labels, means: Means, widest: int, out: Labels, lengths: NDArray[np.uint8]) -> None:
    """Divide the columns, like `_divide_rows`. All columns are processed together, from top to bottom."""
    height, width = labels.shape
    changes, places = np.zeros(width, np.uint8), np.empty(width + 1, np.int32)
    starts, chains = np.zeros(width, np.int32), np.full(width, -1, np.int32)
    for y in range(1, height):
        row, above = labels[y], labels[y - 1]
        for x in range(width):  # this vectorises
            changes[x] = row[x] != above[x]
        for x in places[: nonzero_positions(changes, places)]:
            if chains[x] < 0 or y - starts[x] > widest:
                if 0 < chains[x] < starts[x]:
                    _divide_chain(labels[:, x], chains[x], starts[x], means, widest, out[:, x], lengths[:, x])
                chains[x] = y
            starts[x] = y
    for x in range(width):
        if 0 < chains[x] < starts[x]:
            _divide_chain(labels[:, x], chains[x], starts[x], means, widest, out[:, x], lengths[:, x])


@kernel
def _divide_chain(
    line: NDArray[np.int32], begin: int, end: int, means: Means, widest: int, out: NDArray[np.int32],
    lengths: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Divide the thin regions of pixels [begin, end) of a line, unless their total extent is too large."""
    if end - begin <= _LONGEST_CHAIN * widest:
        _divide(line, begin, end, means, out, lengths)


@kernel
def _divide(
    line: NDArray[np.int32], begin: int, end: int, means: Means, out: NDArray[np.int32], lengths: NDArray[np.uint8]
) -> None:
    """Divide pixels [begin, end) of a line between the regions beside them, unless one is no mixture of these.

    Pixels of a shorter extent in the other direction are left out.
    """
    one, two = line[begin - 1], line[end]
    first, share = np.float32(0), np.float32(0)
    for x in range(begin, end):
        if x == begin or line[x] != line[x - 1]:
            share = _share(means, one, line[x], two)
        if share < 0:
            return
        first += np.float32(1) - share
    border = begin + int(np.rint(first))
    for x in range(begin, end):
        if end - begin < lengths[x]:
            out[x] = one if x < border else two
            lengths[x] = end - begin


@kernel
def _share(means: Means, one: int, between: int, two: int) -> np.float32:
    """Share of the colour `two` in the mixture `between` of `one` and `two`; -1 = it is no mixture of them."""
    square = along = off = np.float32(0)
    for c in range(3):
        span, part = means[two, c] - means[one, c], means[between, c] - means[one, c]
        square += span * span
        along += span * part
        off += part * part
    share = along / max(square, np.float32(1))
    mixed = _LEAST_SHARE <= share <= np.float32(1) - _LEAST_SHARE
    if not mixed or off - along * share > _LARGEST_DEVIATION * _LARGEST_DEVIATION * square:
        return np.float32(-1)
    return share
