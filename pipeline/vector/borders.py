"""Region borders as a graph on the lattice of pixel corners, shared by the two regions on either side.

Node (x, y) of the lattice is the top left corner of pixel (x, y); the frame spans (0, 0) to (width, height). An edge
joins two adjacent nodes and separates two different labels. Both regions use the same nodes: however nodes move, no gap
and no overlap opens between neighbours. The left border of the frame is part of the graph, with label 0 outside, so
that a scanline starts at 0 (`pipeline.vector.fill`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions

Positions = NDArray[np.float32]
"""float32 (nodes, 2): x, y in px of the label map."""
EDGE = np.dtype([("start", np.int32), ("end", np.int32), ("left", np.int32), ("right", np.int32)])
"""A directed edge: its two nodes, and the labels to its left and right on the screen (y points down)."""


class BorderParams(NamedTuple):
    """Constants of the placing of borders."""

    line: int = 64
    """Least ink of a pixel that belongs to a line, 0..255."""
    under_line_px: np.float32 = np.float32(0.9)
    """Distance of a border from the edge of the line that covers it, px: the rim of a line is not opaque."""
    sliver_reach: int = 2
    """Factor on the reach of a line, for the border of a region that continues on the other side of the line."""
    thick_line_px: int = 12
    """Least thickness, px, of a line that does not attract such a border."""


BORDERS = BorderParams()


@dataclass(frozen=True)
class Borders:
    """The borders between the regions of a label map."""

    positions: Positions
    lattice: NDArray[np.int32]
    """int32 (nodes, 2): lattice x, y of every node, its position before smoothing."""
    edges: NDArray[np.void]
    """Structured (`EDGE`), ordered by lattice row."""
    rows: NDArray[np.int32]
    """int32 (height + 2,): edges of lattice row y are edges[rows[y]:rows[y + 1]]."""
    size: tuple[int, int]
    """(width, height) of the label map, px."""


def find_borders(labels: Labels) -> Borders:
    """The border graph of a label map, int32 (height, width), labels > 0."""
    height, width = labels.shape
    count = _count_edges(labels) + height
    edges = np.empty(count, EDGE)
    lattice = np.empty((2 * count + 2, 2), np.int32)
    rows = np.empty(height + 2, np.int32)
    nodes = _find(labels, edges, lattice, rows)
    lattice = lattice[:nodes]
    return Borders(lattice.astype(np.float32), lattice, edges, rows, (width, height))


def hide_borders_under_lines(borders: Borders, labels: Labels, ink: NDArray[np.uint8], reach_px: int) -> Borders:
    """Borders near a line, moved just under its outline.

    A line beside a border leaves a sliver of one region between the two, which widens the edge; and a border
    under a line cannot be seen to move. Where the region between the two continues on the other side of the line, it
    is such a sliver up to twice the reach: the line stands at the edge, and the border lags behind it.

    Args:
        borders: of `labels`, before they are smoothed.
        labels: int32 (height, width).
        ink: uint8 (height, width), coverage by lines at the size of the label map.
        reach_px: distance from a border in which lines are searched, px.
    """
    positions = borders.positions.copy()
    margin = BORDERS.sliver_reach * reach_px
    near = np.asarray(cv2.dilate(ink, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)), np.uint8)
    padded = np.pad(ink, margin)
    _hide_under_lines(positions, borders.lattice, borders.edges, padded, near, labels, reach_px)
    return Borders(positions, borders.lattice, borders.edges, borders.rows, borders.size)


@kernel
def _count_edges(labels: Labels) -> int:
    height, width = labels.shape
    count = np.int64(0)
    for y in range(height):
        row, above = labels[y], labels[max(y - 1, 0)]
        for x in range(1, width):
            count += np.int64(row[x] != row[x - 1]) + np.int64(row[x] != above[x])
        count += np.int64(row[0] != above[0])
    return int(count)


@kernel
def _find(labels: Labels, edges: NDArray[np.void], lattice: NDArray[np.int32], rows: NDArray[np.int32]) -> int:
    """Write `edges`, `lattice` and `rows`; return the number of nodes."""
    height, width = labels.shape
    here = np.full(width + 1, -1, np.int32)
    below = np.full(width + 1, -1, np.int32)
    kinds = np.zeros(width + 1, np.uint8)
    places = np.empty(width + 1, np.int32)
    nodes = used = 0
    for y in range(height + 1):
        rows[y] = used
        row, above = labels[min(y, height - 1)], labels[max(y - 1, 0)]
        inside, crossed = y < height, 0 < y < height
        for x in range(1, width):  # this vectorises; bit 1: an edge down, bit 2: an edge to the right
            kinds[x] = np.uint8(inside & (row[x] != row[x - 1])) | (np.uint8(crossed & (row[x] != above[x])) << 1)
        kinds[0] = np.uint8(inside) | (np.uint8(crossed & (row[0] != above[0])) << 1)
        kinds[width] = 0
        for x in places[: nonzero_positions(kinds, places)]:
            if here[x] < 0:
                here[x] = nodes
                lattice[nodes, 0], lattice[nodes, 1] = x, y
                nodes += 1
            if kinds[x] & 2:
                if here[x + 1] < 0:
                    here[x + 1] = nodes
                    lattice[nodes, 0], lattice[nodes, 1] = x + 1, y
                    nodes += 1
                edges[used]["start"], edges[used]["end"] = here[x], here[x + 1]
                edges[used]["left"], edges[used]["right"] = above[x], row[x]
                used += 1
            if kinds[x] & 1:
                below[x] = nodes
                lattice[nodes, 0], lattice[nodes, 1] = x, y + 1
                nodes += 1
                edges[used]["start"], edges[used]["end"] = here[x], below[x]
                edges[used]["left"], edges[used]["right"] = row[x], row[x - 1] if x > 0 else 0
                used += 1
        here, below = below, here
        below[:] = -1
    rows[height + 1] = used
    return nodes


@kernel
def _displace(
    positions: Positions, lattice: NDArray[np.int32], moves: Positions, counts: Positions, width: int, height: int
) -> None:
    """Move the nodes from their lattice positions by the mean displacement of their edges, in place.

    `moves` and `counts`, float32 (n, 2), are the sum and the number of displacements of each node along each axis. A
    node with edges in both directions, a corner, moves half as far along each. Nodes stay on the frame's border.
    """
    for n in range(positions.shape[0]):
        both = np.float32(0.5) if counts[n, 0] > 0 and counts[n, 1] > 0 else np.float32(1)
        for axis in range(2):
            last = width if axis == 0 else height
            if counts[n, axis] > 0 and 0 < lattice[n, axis] < last:
                positions[n, axis] = np.float32(lattice[n, axis]) + both * moves[n, axis] / counts[n, axis]


@kernel
def _hide_under_lines(
    positions: Positions, lattice: NDArray[np.int32], edges: NDArray[np.void], ink: NDArray[np.uint8],
    near: NDArray[np.uint8], labels: Labels, reach: int,
) -> None:  # fmt: skip
    """Move the nodes of edges beside a line, in place.

    Args:
        ink: with a margin of `BORDERS.sliver_reach` times the reach, without ink, on each side.
        near: uint8 (h, w), the most ink within that distance.
    """
    count = positions.shape[0]
    height, width = labels.shape
    moves = np.zeros((count, 2), np.float32)
    counts = np.zeros((count, 2), np.float32)
    for k in range(edges.shape[0]):
        if edges[k]["right"] == 0:
            continue
        a, b = edges[k]["start"], edges[k]["end"]
        if near[lattice[a, 1], lattice[a, 0]] < BORDERS.line:
            continue
        axis = 0 if lattice[b, 0] == lattice[a, 0] else 1
        move = _to_line(ink, labels, lattice[a, 0], lattice[a, 1], axis, reach)
        if move != 0:
            for n in (a, b):
                moves[n, axis] += move
                counts[n, axis] += np.float32(1)
    _displace(positions, lattice, moves, counts, width, height)


@kernel
def _to_line(ink: NDArray[np.uint8], labels: Labels, x: int, y: int, axis: int, reach: int) -> np.float32:
    """Displacement along `axis` from the edge at lattice position (x, y) to just under the nearest line, px; 0 = no
    line within reach, or the edge is under a line. `ink`: with the margin that `_hide_under_lines` describes."""
    margin, width = BORDERS.sliver_reach * reach, ink.shape[1]
    flat, at = ink.reshape(ink.size), (y + margin) * width + x + margin
    step = 1 if axis == 0 else width
    for k in range(margin):
        ahead, behind = flat[at + k * step], flat[at - (k + 1) * step]
        if max(ahead, behind) < BORDERS.line:
            continue
        if k == 0 and min(ahead, behind) >= BORDERS.line:
            return np.float32(0)
        way = 1 if ahead >= behind else -1
        if k < reach or _crosses_line(ink, labels, x, y, axis, way, k):
            return np.float32(way) * (np.float32(k) + BORDERS.under_line_px)
        return np.float32(0)
    return np.float32(0)


@kernel
def _crosses_line(ink: NDArray[np.uint8], labels: Labels, x: int, y: int, axis: int, way: int, distance: int) -> bool:
    """Whether one region reaches from the edge at lattice position (x, y) to the other side of the line whose first
    pixel lies `distance` px from it, in the direction `way`, 1 or -1, along `axis`."""
    height, width = labels.shape
    margin = (ink.shape[0] - height) // 2
    step_x, step_y = (way, 0) if axis == 0 else (0, way)
    first_x, first_y = x + min(step_x, 0), y + min(step_y, 0)
    own = labels[first_y, first_x]
    for n in range(distance + BORDERS.thick_line_px):
        i, j = first_x + n * step_x, first_y + n * step_y
        if not _is(labels, i, j, own, height, width):
            return False
        if n > distance and ink[j + margin, i + margin] < BORDERS.line:
            return True
    return False


@kernel
def _is(labels: Labels, x: int, y: int, label: int, height: int, width: int) -> bool:
    return 0 <= x < width and 0 <= y < height and labels[y, x] == label
