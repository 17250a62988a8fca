"""Drawing of curves with a pen: half width and opacity at each point, drawn anti-aliased at any size."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.lines.linking import Index

Ink: TypeAlias = NDArray[np.uint8]
"""Opacity of ink, uint8 (h, w), 0..255."""


class Strokes(NamedTuple):
    """Curves with the width and the opacity of a pen.

    Attributes:
        places: float32 (m, 2), x and y, px; the corner of the frame is (0, 0), so that pixel centres are at halves.
        half_widths: float32 (m,), px.
        opacities: float32 (m,), 0..1.
        starts: int32 (strokes + 1,): stroke i has the points starts[i]..starts[i + 1] - 1.
    """

    places: NDArray[np.float32]
    half_widths: NDArray[np.float32]
    opacities: NDArray[np.float32]
    starts: Index


def join_strokes(one: Strokes, other: Strokes) -> Strokes:
    """The strokes of both."""
    places, widths, opacities = (np.concatenate(parts) for parts in zip(one[:3], other[:3], strict=True))
    return Strokes(places, widths, opacities, np.concatenate([one.starts, one.starts[-1] + other.starts[1:]]))


def draw_strokes(strokes: Strokes, size: tuple[int, int]) -> Ink:
    """Coverage of each pixel by strokes, times their opacity: uint8 (height, width), 255 = full ink.

    Overlapping strokes are as opaque as the most opaque one.
    """
    out = np.zeros((size[1], size[0]), np.uint8)
    _draw(strokes, out)
    return out


@kernel
def _draw(strokes: Strokes, out: NDArray[np.uint8]) -> None:
    for k in range(strokes.starts.size - 1):
        for n in range(strokes.starts[k], strokes.starts[k + 1] - 1):
            _draw_piece(strokes, n, out)


@kernel
def _draw_piece(strokes: Strokes, n: int, out: NDArray[np.uint8]) -> None:
    """Draw the piece from point n to the next one, with round ends."""
    height, width = out.shape
    half, one, zero = np.float32(0.5), np.float32(1), np.float32(0)
    x, y = strokes.places[n, 0] - half, strokes.places[n, 1] - half
    run, rise = strokes.places[n + 1, 0] - half - x, strokes.places[n + 1, 1] - half - y
    wide, growth = strokes.half_widths[n], strokes.half_widths[n + 1] - strokes.half_widths[n]
    opaque, change = strokes.opacities[n], strokes.opacities[n + 1] - strokes.opacities[n]
    if max(opaque, opaque + change) * max(wide, wide + growth) < np.float32(1 / 255):
        return
    reach = max(wide, wide + growth) + half
    square = max(run * run + rise * rise, np.float32(1e-12))
    first, last = max(int(np.ceil(min(y, y + rise) - reach)), 0), min(int(max(y, y + rise) + reach), height - 1)
    left, right = max(int(np.ceil(min(x, x + run) - reach)), 0), min(int(max(x, x + run) + reach), width - 1)
    for v in range(first, last + 1):
        down = np.float32(v) - y
        for u in range(left, right + 1):
            across = np.float32(u) - x
            share = min(max((across * run + down * rise) / square, zero), one)
            dx, dy = across - share * run, down - share * rise
            distance, radius = np.sqrt(dx * dx + dy * dy), wide + share * growth
            cover = min(distance + radius, half) - max(distance - radius, -half)
            if cover > 0:
                ink = np.uint8(np.float32(255) * cover * (opaque + share * change) + half)
                out[v, u] = max(out[v, u], ink)
