"""Thin regions of intermediate colour along blurred edges are divided between the two regions beside them.

An edge in a video is several pixels wide, and its pixels are mixtures of the colours on both sides. Segmentation makes
thin regions of them, so that an edge is drawn as a staircase of two or three small steps. Here each row and each column
of such regions is divided between the two regions beside them, in proportion to the mixture: the border then lies where
a sharp edge of the same mean colour would lie. Thin regions of a colour that is no mixture, such as a lip or a wire,
are kept.

Rows that are divided between others that are not, or the reverse, would be teeth, which change from frame to frame.
Along an edge that is about as wide as the limit, the majority of the rows nearby therefore decides, and rows that are
divided along a short piece of an edge only are left as they are.

Departure: this is not part of zhang2011online, whose frames have 352 x 288 px.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions
from pipeline.regions.regions import Means


class RampParams(NamedTuple):
    """Constants of the division of blurred edges."""

    usual_chain: int = 3
    """Largest total extent of adjacent thin regions that are divided together, relative to that of one region."""
    wide_region: float = 5 / 3
    wide_chain: float = 4.5
    """Largest extent of one region, and of adjacent ones, relative to the same, where the majority of the rows is
    within the usual limits."""
    least_share: np.float32 = np.float32(0.06)
    """A mixture has at least this share of either colour; otherwise the region is one of the two itself."""
    largest_deviation: np.float32 = np.float32(0.3)
    """Largest distance of a mixture from the straight line between the two colours, relative to their distance."""
    shortest_piece: float = 4.5
    """Smallest number of adjacent rows or columns that are divided, relative to the largest extent of a thin region."""
    vote: int = 256
    memory: int = 16
    """Vote of a row for dividing; number of rows, in each direction, over which votes are averaged."""
    undivided: int = 255
    """Length of a pixel that is not divided."""


RAMPS = RampParams()


_SPLIT, _USUAL, _WIDE = 0, 1, 2
"""Kinds of spans: parts of a chain that is no mixture or too wide, which do not vote; a chain within the usual limits,
which votes for dividing; a wider one, which votes against it."""

SPAN = np.dtype([("begin", "<i4"), ("end", "<i4"), ("border", "<i4"), ("kind", "<i4")])
"""Pixels [begin, end) of a row, of which those before `border` join the region on the left."""
Spans = NDArray[np.void]
"""SPAN (n,), row after row, from left to right."""
Firsts = NDArray[np.int32]
"""int32 (rows + 1,), index of the first span of each row."""
Lengths = NDArray[np.uint8]
"""uint8 (h, w): extent of the adjacent thin regions that were divided at a pixel, px, or `RAMPS.undivided`."""
Limits = tuple[int, int, int, int]
"""Largest extents, px: of a region and of a chain; of a region and of a chain where the majority is within these."""


def divide_ramps(labels: Labels, means: Means, widest_px: int) -> Labels:
    """Label map without thin regions of intermediate colour, int32 (h, w); regions keep their labels.

    Args:
        labels: int32 (h, w).
        means: float32 (labels, 3), mean colour of each region in 8-bit CIELAB.
        widest_px: usual largest extent of a divided row or column of a region, px; regions side by side that are
            mixtures of the same two colours may have three times that extent together. 0 returns `labels` itself.
    """
    if widest_px <= 0:
        return labels
    widest_px = min(widest_px, int((RAMPS.undivided - 1) / RAMPS.wide_chain))
    out, lengths = labels.copy(), np.full(labels.shape, RAMPS.undivided, np.uint8)
    _divide(labels, means, widest_px, out, lengths)
    turned = np.asarray(cv2.transpose(labels), np.int32)
    _divide(turned, means, widest_px, out.T, lengths.T)
    _remove_ticks(out, lengths)
    return out


def _divide(labels: Labels, means: Means, widest_px: int, out: Labels, lengths: Lengths) -> None:
    """Divide the thin regions of each row, in `out`, where `lengths` has no shorter extent yet."""
    limits = (
        widest_px,
        RAMPS.usual_chain * widest_px,
        round(RAMPS.wide_region * widest_px),
        int(RAMPS.wide_chain * widest_px),
    )
    spans, firsts = _find_spans(labels, means, limits)
    spans, firsts = _follow_majority(labels, means, limits, spans, firsts)
    _write(labels, spans, firsts, round(RAMPS.shortest_piece * widest_px), out, lengths)


@kernel
def _find_spans(labels: Labels, means: Means, limits: Limits) -> tuple[Spans, Firsts]:
    """The spans of all rows that may be divided: chains of thin regions that are mixtures, or parts of them."""
    height, width = labels.shape
    wide = limits[2]
    changes, places = np.zeros(width, np.uint8), np.empty(width + 1, np.int32)
    spans, firsts = np.empty(height * (width // 2 + 1), SPAN), np.empty(height + 1, np.int32)
    count = 0
    for y in range(height):
        firsts[y] = count
        row = labels[y]
        for x in range(1, width):  # this vectorises
            changes[x] = row[x] != row[x - 1]
        start = 0  # of the region before the next change
        chain = -1  # first pixel of the thin regions since the last wide one; -1 = the row's first region
        for x in places[: nonzero_positions(changes, places)]:
            if chain < 0 or x - start > wide:
                if 0 < chain < start:
                    count = _add_chain(row, chain, start, means, limits, spans, count)
                chain = x
            start = x
        if 0 < chain < start:
            count = _add_chain(row, chain, start, means, limits, spans, count)
    firsts[height] = count
    return spans, firsts


@kernel
def _add_chain(
    row: NDArray[np.int32], begin: int, end: int, means: Means, limits: Limits, spans: Spans, count: int
) -> int:
    """Append the thin regions [begin, end) of a row as one span, or as its parts; returns the new number of spans."""
    region, chain, _, wide_chain = limits
    kind = _USUAL if end - begin <= chain else _WIDE
    start = begin
    for x in range(begin + 1, end + 1):
        if row[x] != row[x - 1]:
            if x - start > region:
                kind = _WIDE
            start = x
    border = _border(row, begin, end, means) if end - begin <= wide_chain else -1
    if border >= 0:
        return _add(spans, count, begin, end, border, kind)
    return count if kind == _USUAL else _add_parts(row, begin, end, means, limits, spans, count)


@kernel
def _add_parts(
    row: NDArray[np.int32], begin: int, end: int, means: Means, limits: Limits, spans: Spans, count: int
) -> int:
    """Append the parts of [begin, end) between regions that are wider than usual, unless they are no mixtures."""
    region, chain = limits[0], limits[1]
    start = part = begin
    for x in range(begin + 1, end + 1):
        if row[x] == row[x - 1]:
            continue
        wide = x - start > region
        stop = start if wide else x
        if (wide or x == end) and part < stop <= part + chain:
            border = _border(row, part, stop, means)
            if border >= 0:
                count = _add(spans, count, part, stop, border, _SPLIT)
        if wide:
            part = x
        start = x
    return count


@kernel
def _add(spans: Spans, count: int, begin: int, end: int, border: int, kind: int) -> int:
    spans[count]["begin"], spans[count]["end"] = begin, end
    spans[count]["border"], spans[count]["kind"] = border, kind
    return count + 1


@kernel
def _border(row: NDArray[np.int32], begin: int, end: int, means: Means) -> int:
    """Place that divides pixels [begin, end) of a row between the regions beside them; -1 if one is no mixture."""
    one, two = row[begin - 1], row[end]
    first, share = np.float32(0), np.float32(0)
    for x in range(begin, end):
        if x == begin or row[x] != row[x - 1]:
            share = _share(means, one, row[x], two)
        if share < 0:
            return -1
        first += np.float32(1) - share
    return begin + int(np.rint(first))


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
    mixed = RAMPS.least_share <= share <= np.float32(1) - RAMPS.least_share
    if not mixed or off - along * share > RAMPS.largest_deviation * RAMPS.largest_deviation * square:
        return np.float32(-1)
    return share


@kernel
def _follow_majority(
    labels: Labels, means: Means, limits: Limits, spans: Spans, firsts: Firsts
) -> tuple[Spans, Firsts]:
    """The spans after the vote. Where dividing loses, a usual span is left out, and a wide one replaced by its parts.

    The vote of a span counts less with each row between. Rows are adjacent as in `_write`.
    """
    height, count = len(firsts) - 1, firsts[-1]
    above, below = np.empty(count, np.int32), np.empty(count, np.int32)  # mean votes up to the row, from either side
    for y in range(height):
        _average_votes(spans, firsts, y, -1, above)
    for y in range(height - 1, -1, -1):
        _average_votes(spans, firsts, y, 1, below)
    out, starts = np.empty_like(spans), np.empty(height + 1, np.int32)
    used = 0
    for y in range(height):
        starts[y] = used
        for k in range(firsts[y], firsts[y + 1]):
            span = spans[k]
            if span["kind"] == _SPLIT or above[k] + below[k] >= RAMPS.vote:
                out[used] = span
                used += 1
            elif span["kind"] == _WIDE:
                used = _add_parts(labels[y], span["begin"], span["end"], means, limits, out, used)
    starts[height] = used
    return out, starts


@kernel
def _average_votes(spans: Spans, firsts: Firsts, y: int, step: int, means: NDArray[np.int32]) -> None:
    """Write the running mean of the votes of adjacent rows for each span of row `y`; `step` leads to the row before."""
    for k in range(firsts[y], firsts[y + 1]):
        kind = spans[k]["kind"]
        if kind == _SPLIT:
            means[k] = -1
            continue
        vote = RAMPS.vote if kind == _USUAL else 0
        before = _largest_adjacent(spans, firsts, k, y, step, means)
        means[k] = vote if before < 0 else ((RAMPS.memory - 1) * before + vote + RAMPS.memory // 2) // RAMPS.memory


@kernel
def _largest_adjacent(spans: Spans, firsts: Firsts, k: int, y: int, step: int, values: NDArray[np.int32]) -> int:
    """Largest value of the spans that touch span `k` of row `y`, also diagonally, in the row before, or else in the one
    before that; -1 = there are none."""
    begin, end = spans[k]["begin"], spans[k]["end"]
    most = -1
    for other in (y + step, y + 2 * step):
        if most < 0 and 0 <= other < len(firsts) - 1:
            low, high = firsts[other], firsts[other + 1]
            while low < high:  # the first span that does not end before this one
                middle = (low + high) // 2
                if spans[middle]["end"] < begin:
                    low = middle + 1
                else:
                    high = middle
            while low < firsts[other + 1] and spans[low]["begin"] <= end:
                most = max(most, int(values[low]))
                low += 1
    return most


@kernel
def _write(labels: Labels, spans: Spans, firsts: Firsts, shortest: int, out: Labels, lengths: Lengths) -> None:
    """Write the divided rows to `out`, where they are shorter than `lengths`.

    Rows of a piece of fewer than `shortest` adjacent ones are not divided.
    Rows are adjacent where their spans touch, also diagonally, or where a single row lies between them.
    """
    height, count = len(firsts) - 1, firsts[-1]
    above, below = np.empty(count, np.int32), np.empty(count, np.int32)  # adjacent rows up to this one
    for y in range(height):
        for k in range(firsts[y], firsts[y + 1]):
            above[k] = max(_largest_adjacent(spans, firsts, k, y, -1, above), 0) + 1
    for y in range(height - 1, -1, -1):
        for k in range(firsts[y], firsts[y + 1]):
            below[k] = max(_largest_adjacent(spans, firsts, k, y, 1, below), 0) + 1
            if above[k] + below[k] - 1 < shortest:
                continue
            begin, end, border = spans[k]["begin"], spans[k]["end"], spans[k]["border"]
            for x in range(begin, end):
                if end - begin < lengths[y, x]:
                    lengths[y, x] = end - begin
                    out[y, x] = labels[y, begin - 1] if x < border else labels[y, end]


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
            inside = (max(here[x - 1], here[x + 1]) < RAMPS.undivided) | (max(over[x], under[x]) < RAMPS.undivided)
            between[x] = np.uint8((here[x] == RAMPS.undivided) & inside)
        for x in places[: nonzero_positions(between, places)]:
            across = max(lengths[y, x - 1], lengths[y, x + 1]) < RAMPS.undivided and row[x - 1] == row[x + 1]
            along = max(lengths[y - 1, x], lengths[y + 1, x]) < RAMPS.undivided and above[x] == below[x]
            if across:
                row[x] = row[x - 1]
            elif along:
                row[x] = above[x]
