"""A segmented frame as SVG: every region a path with its boundary and colour (zhang2011online, section 7).

A region's id is `r` and the name it keeps from frame to frame, so the regions of two frames correspond by id.
Neighbours share their boundary to the last digit. Renderers soften both sides of a shared boundary on their own, which
lets the ground shine through as a hairline; so every region also has a stroke of its own colour, thin enough (0.6 px)
that no pixel centre changes hands.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadFrame
from pipeline.frames import Labels, Plane
from pipeline.vector.outlines import Outlines, rings, simplify, smooth, trace

PARTS_PER_PX = 10
"""Coordinates are rounded to this fraction of a pixel."""


def to_svg(
    labels: Labels,
    colours: NDArray[np.uint8],
    ids: NDArray[np.integer] | None = None,
    *,
    ink: Plane | None = None,
    ink_colour: Sequence[int] = (0, 0, 0),
    tolerance_px: float = 0.5,
    smoothing: int = 4,
) -> bytes:
    """One frame as a stand-alone SVG document, UTF-8.

    Args:
        labels: int32 (height, width), the regions; 0 = no region, left transparent.
        colours: uint8 (n, 3) sRGB, row l is the colour of label l.
        ids: (n,) integers, row l is the lasting name of label l; None = the labels themselves.
        ink: the line layer, (height, width) in 0..1, 1 = full ink; outlined where it is at least a half.
        ink_colour: sRGB of the lines, 0..255.
        tolerance_px: how far a simplified boundary may lie from the smoothed one, px; 0 = not at all.
        smoothing: low-pass passes over every boundary, 0 = the pixels' own stairs. With 0 and 0 the document filled
            by the even-odd rule at pixel centres gives back `labels` exactly.

    Raises:
        BadFrame: labels, colours, ids or ink do not fit each other.
    """
    _check(labels, colours, ids, ink)
    names = np.arange(len(colours)) if ids is None else ids
    height, width = labels.shape
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
            *([] if ink is None else _ink(ink, _hex(ink_colour), tolerance_px, smoothing)),
            "</svg>\n",
        ]
    ).encode()


def _ink(ink: Plane, colour: str, tolerance_px: float, smoothing: int) -> list[str]:
    drawn = _paths((ink >= 0.5).astype(np.int32), tolerance_px, smoothing)
    return [f'<path id="lines" fill="{colour}" d="{path}"/>' for path in drawn.values()]


def _paths(labels: Labels, tolerance_px: float, smoothing: int) -> dict[int, str]:
    """Path data by label."""
    outlines = simplify(smooth(trace(labels), smoothing), tolerance_px)
    text = _ArcText(outlines)
    return {label: "".join(text.ring(chain) for chain in chains) for label, chains in rings(outlines).items()}


class _ArcText:
    """Every arc as text, both ways, written once: relative moves, so that arcs can be strung together."""

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
        raise BadFrame("A label map is an integer array (height, width).", field="labels", value=labels.shape)
    lowest, highest = int(labels.min()), int(labels.max())
    if lowest < 0:
        raise BadFrame("Labels are 0 or more.", field="labels", value=lowest)
    if colours.ndim != 2 or colours.shape[1] != 3 or colours.dtype != np.uint8:
        raise BadFrame("Colours are uint8 (n, 3).", field="colours", value=f"{colours.dtype} {colours.shape}")
    if highest >= len(colours):
        raise BadFrame("A label has no colour.", field="colours", value=highest, remedy="Give a row for every label.")
    if ids is not None and len(ids) != len(colours):
        raise BadFrame("There are as many ids as colours.", field="ids", value=f"{len(ids)} for {len(colours)}")
    if ink is not None and ink.shape != labels.shape:
        raise BadFrame("The ink has the size of the labels.", field="ink", value=ink.shape)
