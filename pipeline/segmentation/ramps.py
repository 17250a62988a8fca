"""Thin regions of intermediate colour along blurred edges are divided between the two regions beside them.

An edge in a video is several pixels wide, and its pixels are mixtures of the colours on both sides. Segmentation makes
thin regions of them, so that an edge is drawn as a staircase of two or three small steps. Here each row and each column
of such a region is divided between its two neighbours, in proportion to the mixture: the border then lies where a sharp
edge of the same mean colour would lie. Thin regions of a colour that is no mixture, such as a lip or a wire, are kept.
So are rows or columns that are divided along a short piece of an edge only: with undivided ones above and below, they
would be teeth, which change from frame to frame.

Departure: this is not part of zhang2011online, whose frames have 352 x 288 px.
"""

from __future__ import annotations

import cv2
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
_SHORTEST_PIECE = 4.5
"""Smallest number of adjacent rows or columns that are divided, relative to the largest extent of a thin region."""
_UNDIVIDED = 255
"""Length of a pixel that is not divided."""

Lengths = NDArray[np.uint8]
"""uint8 (h, w): extent of the adjacent thin regions that were divided at a pixel, px, or `_UNDIVIDED`."""


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
    widest_px = min(widest_px, (_UNDIVIDED - 1) // _LONGEST_CHAIN)
    shortest = min(round(_SHORTEST_PIECE * widest_px), _UNDIVIDED)
    across, widths = labels.copy(), np.full(labels.shape, _UNDIVIDED, np.uint8)
    _divide_rows(labels, means, widest_px, across, widths)
    _undo_short_pieces(widths, shortest)
    down, heights = labels.copy(), np.full(labels.shape, _UNDIVIDED, np.uint8)
    _divide_columns(labels, means, widest_px, down, heights)
    turned = np.asarray(cv2.transpose(heights), np.uint8)
    _undo_short_pieces(turned, shortest)
    heights = np.asarray(cv2.transpose(turned), np.uint8)
    out = labels.copy()
    _take_shorter(across, widths, down, heights, out)
    _remove_ticks(out, np.minimum(widths, heights))
    return out


@kernel
def _undo_short_pieces(lengths: Lengths, shortest: int) -> None:
    """Mark divided pixels as undivided where fewer than `shortest` adjacent rows are divided, in place.

    Rows are adjacent where their divided pixels touch, also diagonally, or where a single row lies between them.
    """
    height, width = lengths.shape
    above = np.zeros((height, width), np.uint8)  # adjacent divided rows down to this one
    below = np.zeros((height, width), np.uint8)  # the same from the other side
    divided, places = np.zeros(width, np.uint8), np.empty(width, np.int32)
    runs, ends = np.empty((height * (width // 2 + 1), 2), np.int32), np.empty(height + 1, np.int32)
    count = 0
    for y in range(height):
        ends[y] = count
        for x in range(width):  # this vectorises
            divided[x] = lengths[y, x] != _UNDIVIDED
        used = nonzero_positions(divided, places)
        for k in range(used):
            if k == 0 or places[k] != places[k - 1] + 1:
                runs[count, 0] = places[k]
                count += 1
            runs[count - 1, 1] = places[k] + 1
        _count_rows(runs[ends[y] : count], above[max(y - 1, 0)], above[max(y - 2, 0)], above[y])
    ends[height] = count
    for y in range(height - 1, -1, -1):
        row = runs[ends[y] : ends[y + 1]]
        _count_rows(row, below[min(y + 1, height - 1)], below[min(y + 2, height - 1)], below[y])
        for k in range(len(row)):
            start, stop = row[k]
            if np.int32(above[y, start]) + np.int32(below[y, start]) - 1 < shortest:
                lengths[y, start:stop] = _UNDIVIDED


@kernel
def _count_rows(
    runs: NDArray[np.int32], near: NDArray[np.uint8], far: NDArray[np.uint8], out: NDArray[np.uint8]
) -> None:
    """For each run [start, stop) of divided pixels of a row, write the number of adjacent rows up to it to `out`.

    `near` and `far`: those numbers for the row before and for the row before that; 0 where nothing is divided.
    """
    for k in range(len(runs)):
        start, stop = runs[k]
        left, right = max(start - 1, 0), min(stop + 1, out.size)
        most = 0
        for x in range(left, right):
            most = max(most, int(near[x]))
        if most == 0:
            for x in range(left, right):
                most = max(most, int(far[x]))
        out[start:stop] = np.uint8(min(most + 1, 254))


@kernel
def _take_shorter(across: Labels, widths: Lengths, down: Labels, heights: Lengths, out: Labels) -> None:
    """Write the divided rows, `across`, and columns, `down`, to `out`; where both divide a pixel, the shorter one."""
    height, width = out.shape
    divided, places = np.zeros(width, np.uint8), np.empty(width, np.int32)
    for y in range(height):
        row, column = widths[y], heights[y]
        for x in range(width):  # this vectorises
            divided[x] = min(row[x], column[x]) != _UNDIVIDED
        for x in places[: nonzero_positions(divided, places)]:
            out[y, x] = down[y, x] if column[x] < row[x] else across[y, x]


@kernel
def _remove_ticks(out: Labels, lengths: Lengths) -> None:
    """Undivided pixels between two divided ones of the same label take that label. Otherwise a row or column whose
    colour is not quite a mixture would protrude from the border."""
    height, width = out.shape
    between, places = np.zeros(width, np.uint8), np.empty(width, np.int32)
    for y in range(1, height - 1):
        row, above, below = out[y], out[y - 1], out[y + 1]
        here, over, under = lengths[y], lengths[y - 1], lengths[y + 1]
        for x in range(1, width - 1):  # this vectorises
            inside = (max(here[x - 1], here[x + 1]) < _UNDIVIDED) | (max(over[x], under[x]) < _UNDIVIDED)
            between[x] = np.uint8((here[x] == _UNDIVIDED) & inside)
        for x in places[: nonzero_positions(between, places)]:
            across = max(lengths[y, x - 1], lengths[y, x + 1]) < _UNDIVIDED and row[x - 1] == row[x + 1]
            along = max(lengths[y - 1, x], lengths[y + 1, x]) < _UNDIVIDED and above[x] == below[x]
            if across:
                row[x] = row[x - 1]
            elif along:
                row[x] = above[x]


@kernel
def _divide_rows(labels: Labels, means: Means, widest: int, out: Labels, lengths: Lengths) -> None:
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
def _divide_columns(labels: Labels, means: Means, widest: int, out: Labels, lengths: Lengths) -> None:
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
    lengths: Lengths,
) -> None:  # fmt: skip
    """Divide the thin regions of pixels [begin, end) of a line, unless their total extent is too large."""
    if end - begin <= _LONGEST_CHAIN * widest:
        _divide(line, begin, end, means, out, lengths)


@kernel
def _divide(
    line: NDArray[np.int32], begin: int, end: int, means: Means, out: NDArray[np.int32], lengths: Lengths
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
