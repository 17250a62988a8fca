"""A segmented frame as SVG: each region is a path with its boundary and colour (zhang2011online, section 7).

The id of a path is `r` followed by the region's permanent id, so the regions of two frames correspond by id. Neighbours
share their boundary exactly. Renderers anti-alias both sides of a shared boundary independently, which makes the
background visible as a thin line. Each region therefore also has a stroke of its own colour, which is so thin (0.6 px)
that it covers no other pixel centre.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadFrame
from pipeline.frames import Labels, Plane
from pipeline.vector.borders import Borders
from pipeline.vector.outlines import Outlines, follow, rings, simplify, smooth, trace

PARTS_PER_PX = 10
"""Coordinates are rounded to 1 / PARTS_PER_PX px."""
DEFAULT_PASSES = 4
"""Low-pass passes over boundaries that are not smoothed yet."""


def to_svg(
    labels: Labels,
    colours: NDArray[np.uint8],
    ids: NDArray[np.integer] | None = None,
    *,
    ink: Plane | None = None,
    ink_colour: Sequence[int] = (0, 0, 0),
    tolerance_px: float = 0.5,
    smoothing: int | Borders = DEFAULT_PASSES,
) -> bytes:
    """Write one frame as a stand-alone SVG document, UTF-8.

    Args:
        labels: int32 (height, width), regions; 0 = no region, transparent.
        colours: uint8 (n, 3), sRGB by label.
        ids: (n,) integers, permanent ids by label; None = the labels.
        ink: line layer, float32 (height, width), 0..1, 1 = full ink; the area with at least 0.5 is outlined.
        ink_colour: sRGB of the lines, 0..255.
        tolerance_px: largest distance of the simplified from the smoothed boundary, px.
        smoothing: number of low-pass passes over each boundary; 0 = the pixels' edges. If both are 0, filling the
            document by the even-odd rule at pixel centres gives `labels` exactly. Or the smoothed borders of `labels`,
            which are drawn as they are; the outlines of `ink` then get the default number of passes.

    Raises:
        BadFrame: labels, colours, ids or ink are inconsistent.
    """
    _check(labels, colours, ids, ink)
    names = np.arange(len(colours)) if ids is None else ids
    height, width = labels.shape
    ink_smoothing = DEFAULT_PASSES if isinstance(smoothing, Borders) else smoothing
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}" fill-rule="evenodd">',
            '<g id="regions" stroke-width="0.6" stroke-linejoin="round">',
            *(
                f'<path id="r{names[label]}" fill="{colour}" stroke="{colour}" d="{path}"/>'
                for label, path in _paths(labels, tolerance_px, smoothing).items()
                for colour in [_hex(colours[label])]
            ),
            "</g>",
            *([] if ink is None else _ink(ink, _hex(ink_colour), tolerance_px, ink_smoothing)),
            "</svg>\n",
        ]
    ).encode()


def _ink(ink: Plane, colour: str, tolerance_px: float, smoothing: int) -> list[str]:
    drawn = _paths((ink >= 0.5).astype(np.int32), tolerance_px, smoothing)
    return [f'<path id="lines" fill="{colour}" d="{path}"/>' for path in drawn.values()]


def _paths(labels: Labels, tolerance_px: float, smoothing: int | Borders) -> dict[int, str]:
    """SVG path data by label."""
    arcs = trace(labels)
    arcs = follow(arcs, smoothing) if isinstance(smoothing, Borders) else smooth(arcs, smoothing)
    outlines = simplify(arcs, tolerance_px)
    text = _ArcText(outlines)
    return {label: "".join(text.ring(chain) for chain in chains) for label, chains in rings(outlines).items()}


class _ArcText:
    """Text of each arc in both directions, as relative moves, so that arcs can be concatenated."""

    def __init__(self, outlines: Outlines) -> None:
        grid = np.rint(outlines.points * PARTS_PER_PX).astype(np.int64)
        moves = np.diff(grid, axis=0)
        most = int(max(np.abs(grid).max(initial=0), np.abs(moves).max(initial=0)))
        self._number = [f"{value / PARTS_PER_PX:g}" for value in range(-most, most + 1)]
        self._zero = most
        self._grid = grid
        self._starts = outlines.starts.tolist()
        self._ways = {False: self._words(moves), True: self._words(-moves[::-1])}
        self._moves = len(moves)

    def ring(self, chain: list[tuple[int, bool]]) -> str:
        arc, backwards = chain[0]
        begin = self._starts[arc + 1] - 1 if backwards else self._starts[arc]
        x, y = (self._number[int(value) + self._zero] for value in self._grid[begin])
        return f"M{x} {y}l{' '.join(self._arc(*link) for link in chain)}z"

    def _arc(self, arc: int, backwards: bool) -> str:
        begin, end = self._starts[arc], self._starts[arc + 1] - 1
        if backwards:
            begin, end = self._moves - end, self._moves - begin
        return " ".join(self._ways[backwards][begin:end])

    def _words(self, moves: NDArray[np.int64]) -> list[str]:
        flat = [self._number[value] for value in (moves + self._zero).ravel().tolist()]
        return [f"{x} {y}" for x, y in zip(flat[::2], flat[1::2], strict=True)]


def _hex(colour: Sequence[int] | NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in colour)


def _check(labels: Labels, colours: NDArray[np.uint8], ids: NDArray[np.integer] | None, ink: Plane | None) -> None:
    if labels.ndim != 2 or not np.issubdtype(labels.dtype, np.integer) or labels.size == 0:
        raise BadFrame("A label map must be an integer array (height, width).", field="labels", value=labels.shape)
    lowest, highest = int(labels.min()), int(labels.max())
    if lowest < 0:
        raise BadFrame("Labels must not be negative.", field="labels", value=lowest)
    if colours.ndim != 2 or colours.shape[1] != 3 or colours.dtype != np.uint8:
        raise BadFrame("Colours must be uint8 (n, 3).", field="colours", value=f"{colours.dtype} {colours.shape}")
    if highest >= len(colours):
        raise BadFrame("A label has no colour.", field="colours", value=highest, remedy="Give a row for every label.")
    if ids is not None and len(ids) != len(colours):
        raise BadFrame("Each colour needs one id.", field="ids", value=f"{len(ids)} for {len(colours)}")
    if ink is not None and ink.shape != labels.shape:
        raise BadFrame("The ink must have the size of the labels.", field="ink", value=ink.shape)
