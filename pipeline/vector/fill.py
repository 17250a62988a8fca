"""Rasterisation of regions: each pixel is the mean of the colours that cover it, weighted by exact area.

A row of a piecewise constant picture is the running sum of its colour steps. An edge between two colours adds its
step, weighted with the area to its right, to the pixels it crosses; a running sum along the row then gives the
coverage anti-aliased picture. Neighbours share edges, so coverage sums to 1 in every pixel, junctions included. Sums
are integers, so pixels inside a region have exactly its colour.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.vector.borders import Borders

_UNITS = 256
"""Units per pixel of fixed-point positions; coverage is in units of 1 / 65536."""
_BAND_ROWS = 32
"""Rows that are filled at a time: their sums stay in the processor's cache."""


class ColourStep(NamedTuple):
    """Change of the colour across an edge, from right to left, levels."""

    red: np.int32
    green: np.int32
    blue: np.int32


def fill_regions(
    borders: Borders, colours: NDArray[np.uint8], size: tuple[int, int], background: FrameExecutor = INLINE
) -> Frame:
    """The regions in their colours, borders anti-aliased at the size of the picture.

    Args:
        borders: of a label map of any size; enlarged to `size` before it is filled.
        colours: uint8 (labels + 1, 3), RGB by label.
        size: (width, height) of the picture, px.

    Returns: uint8 (height, width, 3).
    """
    width, height = size
    scale = np.array([width, height], np.float64) / borders.size
    places = np.rint(borders.positions * (scale * _UNITS).astype(np.float32)).astype(np.int32)
    reach = np.abs(borders.positions[:, 1] - borders.lattice[:, 1]).max(initial=0.0)
    spans = _row_spans(borders.rows, float(scale[1]), float(reach), height)
    steps = colours.astype(np.int32)
    steps[0] = 0
    out = np.empty((height, width, 3), np.uint8)
    background.rows(lambda first, last: _fill(places, borders.edges, spans, steps, out, first, last), height)
    return out


def _row_spans(rows: NDArray[np.int32], scale: float, reach: float, height: int) -> NDArray[np.int32]:
    """int32 (height, 2): first and last edge that may touch each row of the picture."""
    row = np.arange(height)
    first = np.clip(np.floor(row / scale - reach).astype(np.int64) - 1, 0, len(rows) - 2)
    last = np.clip(np.ceil((row + 1) / scale + reach).astype(np.int64) + 1, 0, len(rows) - 1)
    return np.column_stack([rows[first], rows[last]]).astype(np.int32)


@kernel
def _fill(
    places: NDArray[np.int32], edges: NDArray[np.void], spans: NDArray[np.int32], colours: NDArray[np.int32],
    out: Frame, first: int, last: int,
) -> None:  # fmt: skip
    width = out.shape[1]
    sums = np.zeros((_BAND_ROWS, 3 * width + 6), np.int32)
    for top in range(first, last, _BAND_ROWS):
        bottom = min(top + _BAND_ROWS, last)
        for k in range(spans[top, 0], spans[bottom - 1, 1]):
            _add_edge(places, edges[k], colours, top, bottom, width, sums)
        for y in range(top, bottom):
            _write_row(sums[y - top], out[y])


@kernel
def _add_edge(
    places: NDArray[np.int32], edge: np.void, colours: NDArray[np.int32], top: int, bottom: int,
    width: int, sums: NDArray[np.int32],
) -> None:  # fmt: skip
    """Add an edge's colour steps to the rows [top, bottom) that it crosses."""
    x0, y0 = places[edge["start"], 0], places[edge["start"], 1]
    x1, y1 = places[edge["end"], 0], places[edge["end"], 1]
    one, two = edge["left"], edge["right"]
    if y0 == y1 or one == two:
        return
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
        one, two = two, one
    step = ColourStep(
        colours[one, 0] - colours[two, 0], colours[one, 1] - colours[two, 1], colours[one, 2] - colours[two, 2]
    )
    if step.red == 0 and step.green == 0 and step.blue == 0:
        return
    low, high = max(y0, np.int32(top << 8)), min(y1, np.int32(bottom << 8))
    if low >= high:
        return
    run, rise = np.int64(x1 - x0), np.int64(y1 - y0)
    ya = low
    xa = np.int32(x0 + run * (ya - y0) // rise)
    while ya < high:
        row = ya >> 8
        yb = min(np.int32((row + 1) << 8), high)
        xb = np.int32(x0 + run * (yb - y0) // rise) if yb != y1 else x1
        _add_part(sums, row - top, width, (xa, xb), yb - ya, step)
        xa, ya = xb, yb


@kernel
def _add_part(
    sums: NDArray[np.int32], row: int, width: int, span: tuple[np.int32, np.int32], tall: np.int32, step: ColourStep
) -> None:
    """Add the part of an edge within one row, which has its ends at the x positions `span` and is `tall` units high."""
    left, right = min(span[0], span[1]), max(span[0], span[1])
    wide = right - left
    start, remaining = left, tall
    while True:
        column = start >> 8
        stop = min(np.int32((column + 1) << 8), right)
        part = remaining if stop == right else np.int32(np.int64(tall) * (stop - start) // wide)
        inside = ((start + stop) >> 1) - (column << 8)
        if column < 0:
            column, inside = np.int32(0), np.int32(0)
        if column < width:
            near, far = part * (256 - inside), part * inside
            at = 3 * column
            sums[row, at] += near * step.red
            sums[row, at + 1] += near * step.green
            sums[row, at + 2] += near * step.blue
            sums[row, at + 3] += far * step.red
            sums[row, at + 4] += far * step.green
            sums[row, at + 5] += far * step.blue
        remaining -= part
        if stop == right:
            return
        start = stop


@kernel
def _write_row(row: NDArray[np.int32], out: NDArray[np.uint8]) -> None:
    """The running sums of a row as pixels; sets the row to 0."""
    red = green = blue = np.int32(0)
    r = g = b = np.uint8(0)
    for x in range(out.shape[0]):
        at = 3 * x
        if row[at] | row[at + 1] | row[at + 2]:
            red += row[at]
            green += row[at + 1]
            blue += row[at + 2]
            row[at] = row[at + 1] = row[at + 2] = 0
            r = np.uint8(min(max((red + 32768) >> 16, np.int32(0)), np.int32(255)))
            g = np.uint8(min(max((green + 32768) >> 16, np.int32(0)), np.int32(255)))
            b = np.uint8(min(max((blue + 32768) >> 16, np.int32(0)), np.int32(255)))
        out[x, 0], out[x, 1], out[x, 2] = r, g, b
    row[3 * out.shape[0] :] = 0
