"""A segmented frame as SVG: each region is a path with its boundary and colour (zhang2011online, section 7).

Boundaries are cubic Bezier curves (`pipeline.vector.curves`); pieces that are straight are written as lines.

The id of a path is `r` followed by the region's permanent id, so the regions of two frames correspond by id. Neighbours
share their boundary exactly. Renderers anti-alias both sides of a shared boundary independently, which makes the
background visible as a thin line. Each region therefore also has a stroke of its own colour, which is so thin (0.6 px)
that it covers no other pixel centre.

Lines are strokes of a pen: each is a path around its outline.

The attribute `data-from-previous` of a path is its motion since the previous frame: the `matrix(...)` of an SVG
transform that moves the region of the previous frame to its place in this one. For a line, whose path has no id, it is
the motion of the place: its inverse moves the line to where it was. New regions have none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadFrame
from pipeline.frames import Labels
from pipeline.vector.borders import Borders
from pipeline.vector.curves import fit_curves
from pipeline.vector.outlines import Outlines, follow, rings, simplify, smooth, trace
from pipeline.vector.stroke_outlines import StrokeOutlines
from pipeline.vector.transforms import Transforms

PARTS_PER_PX = 10
"""Coordinates are rounded to 1 / PARTS_PER_PX px."""
STROKE_TOLERANCE_PX = 0.1
"""Largest distance of the curves from the outline of a stroke, px."""
DEFAULT_PASSES = 4
"""Low-pass passes over boundaries that are not smoothed yet."""


class Lines(NamedTuple):
    """Lines of one colour.

    Attributes:
        strokes: their outlines, px of the picture.
        rgb: sRGB, 0..255.
        opacity: of full ink, 0..1.
    """

    strokes: StrokeOutlines
    rgb: Sequence[int] = (0, 0, 0)
    opacity: float = 1.0


class Motion(NamedTuple):
    """Motion since the previous frame, px of the picture, see `pipeline.vector.transforms`.

    Attributes:
        regions: of each label.
        lines: of each stroke.
    """

    regions: Transforms
    lines: Transforms


def to_svg(
    labels: Labels,
    colours: NDArray[np.uint8],
    ids: NDArray[np.integer] | None = None,
    *,
    lines: Lines | None = None,
    tolerance_px: float = 0.5,
    smoothing: int | Borders = DEFAULT_PASSES,
    size: tuple[int, int] | None = None,
    motion: Motion | None = None,
) -> bytes:
    """Write one frame as a stand-alone SVG document, UTF-8.

    Args:
        labels: int32 (height, width), regions; 0 = no region, transparent.
        colours: uint8 (n, 3), sRGB by label.
        ids: (n,) integers, permanent ids by label; None = the labels.
        lines: over the regions; None = no lines.
        tolerance_px: largest distance of the curves from the smoothed boundary, px; 0 = straight lines between all its
            points.
        smoothing: number of low-pass passes over each boundary; 0 = the pixels' edges. If both are 0, filling the
            document by the even-odd rule at pixel centres gives `labels` exactly. Or the smoothed borders of `labels`,
            which are drawn as they are.
        size: (width, height) of the picture, px; the regions are enlarged to it. None = that of `labels`.
        motion: of regions and lines since the previous frame; None = not written.

    Raises:
        BadFrame: labels, colours or ids are inconsistent.
    """
    _check(labels, colours, ids)
    width, height = size or (labels.shape[1], labels.shape[0])
    names = np.arange(len(colours)) if ids is None else ids
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}" fill-rule="evenodd">',
            '<g id="regions" stroke-width="0.6" stroke-linejoin="round">',
            *(
                f'<path id="r{names[label]}"{_moved(motion and motion.regions, label)} fill="{colour}" '
                f'stroke="{colour}" d="{path}"/>'
                for label, path in _paths(labels, tolerance_px, smoothing, (width, height)).items()
                for colour in [_hex(colours[label])]
            ),
            "</g>",
            *([] if lines is None else _lines(lines, motion)),
            "</svg>\n",
        ]
    ).encode()


def _lines(lines: Lines, motion: Motion | None) -> list[str]:
    text = _ArcText(fit_curves(lines.strokes.arcs, STROKE_TOLERANCE_PX))
    paths = [
        f'<path{_moved(motion and motion.lines, arc)} fill-opacity="{lines.opacity * own:.2f}" '
        f'd="{text.ring([(arc, False)])}"/>'
        for arc, own in enumerate(lines.strokes.opacities.tolist())
    ]
    return [f'<g id="lines" fill="{_hex(lines.rgb)}" fill-rule="nonzero">', *paths, "</g>"]


def _moved(transforms: Transforms | None, index: int) -> str:
    """The attribute with a map, or nothing if there is none."""
    if transforms is None or np.isnan(transforms[index]).any():
        return ""
    (a, c, e), (b, d, f) = transforms[index].tolist()
    numbers = [f"{value:.5g}" for value in (a, b, c, d)] + [f"{value:.2f}" for value in (e, f)]
    return f' data-from-previous="matrix({" ".join(numbers)})"'


def _paths(
    labels: Labels, tolerance_px: float, smoothing: int | Borders, size: tuple[int, ...]
) -> dict[int, str]:  # fmt: skip
    """SVG path data by label, in px of a picture of (width, height) `size`."""
    arcs = trace(labels)
    arcs = follow(arcs, smoothing) if isinstance(smoothing, Borders) else smooth(arcs, smoothing)
    arcs = replace(arcs, points=arcs.points * np.divide(size, labels.shape[::-1]))
    curved = smoothing != 0 and tolerance_px > 0
    outlines = fit_curves(arcs, tolerance_px) if curved else simplify(arcs, tolerance_px)
    text = _ArcText(outlines)
    return {label: "".join(text.ring(chain) for chain in chains) for label, chains in rings(outlines).items()}


class _ArcText:
    """Text of each line or curve in both directions, with relative coordinates, so that arcs can be concatenated."""

    def __init__(self, outlines: Outlines) -> None:
        self._grid = np.rint(outlines.points * PARTS_PER_PX).astype(np.int64)
        most = 2 * int(np.abs(self._grid).max(initial=0))
        self._number = [f"{value / PARTS_PER_PX:g}" for value in range(-most, most + 1)]
        self._zero = most
        self._starts = outlines.starts.tolist()
        self._pieces = ((outlines.starts - np.arange(len(outlines.starts))) // outlines.degree).tolist()
        pieces = [np.arange(a, b - 1, outlines.degree) for a, b in pairwise(self._starts)]
        begin = np.concatenate([np.empty(0, np.int64), *pieces])
        places = begin[:, None] + np.arange(outlines.degree + 1)
        self._ways = {False: self._path_data(self._grid[places]), True: self._path_data(self._grid[places[:, ::-1]])}

    def ring(self, chain: list[tuple[int, bool]]) -> str:
        """Path data of a closed chain of (arc, backwards)."""
        arc, backwards = chain[0]
        begin = self._starts[arc + 1] - 1 if backwards else self._starts[arc]
        x, y = (self._number[int(value) + self._zero] for value in self._grid[begin])
        text, command = [f"M{x} {y}"], ""
        for word in (word for link in chain for word in self._arc(*link)):
            text.append(" " if word[0] == command else word[0])
            text.append(word[1:])
            command = word[0]
        return "".join(text) + "z"

    def _arc(self, arc: int, backwards: bool) -> list[str]:
        words = self._ways[backwards][self._pieces[arc] : self._pieces[arc + 1]]
        return words[::-1] if backwards else words

    def _path_data(self, points: NDArray[np.int64]) -> list[str]:
        """Command and relative coordinates of each line or curve, from its control points (n, degree + 1, 2)."""
        moves = points[:, 1:] - points[:, :1]
        straight = _straight(moves)
        names = [
            [self._number[value + self._zero] for value in row]
            for row in moves.reshape(len(moves), 2 * moves.shape[1]).tolist()
        ]
        return [
            "l" + " ".join(row[-2:]) if line else "c" + " ".join(row)
            for row, line in zip(names, straight.tolist(), strict=True)
        ]


def _straight(moves: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the inner control points are on the chord to half a unit of the last digit; moves from the start."""
    chord = moves[:, -1:]
    off = np.abs(moves[..., 0] * chord[..., 1] - moves[..., 1] * chord[..., 0]).max(axis=1)
    return np.asarray(4 * off * off <= (chord[:, 0] ** 2).sum(axis=1))


def _hex(colour: Sequence[int] | NDArray[np.uint8]) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in colour)


def _check(labels: Labels, colours: NDArray[np.uint8], ids: NDArray[np.integer] | None) -> None:
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
