"""Boundaries of a label map as arcs that are shared by neighbouring regions.

Boundaries run on the lattice of pixel corners: (w + 1) x (h + 1) nodes, node (x, y) being the top left corner of pixel
(x, y). A *junction* is a node with more than two boundary edges, or a corner of the frame. An *arc* is the chain of
edges between two junctions, or a loop without junction. Both regions beside an arc use the same arc, so changes to it
open no gap and no overlap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.kernels.jit import kernel
from pipeline.vector.borders import Borders

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Outlines:
    """Arcs of a label map. Coordinates are those of pixel corners: the frame spans (0, 0) to (width, height).

    Attributes:
        points: float64 (n, 2), x and y of all arcs, px. The first and last point of an arc are junctions, or the same
            point of a loop.
        starts: int64 (arcs + 1,): arc i is points[starts[i]:starts[i + 1]].
        left, right: int32 (arcs,), labels to the left and right in the direction of the arc on the screen (y points
            down); 0 = no region.
        loops: bool (arcs,), whether the arc is a loop without junction.
        degree: 1 = straight lines between the points; 3 = cubic Bezier curves: the first control point of an arc, then
            three for each curve.
    """

    points: Points
    starts: NDArray[np.int64]
    left: NDArray[np.int32]
    right: NDArray[np.int32]
    loops: NDArray[np.bool_]
    degree: int = 1


def trace(labels: Labels) -> Outlines:
    """Trace the arcs between the labels of a map; the outside of the frame counts as label 0.

    Args:
        labels: int32 (height, width), 0 = no label.
    """
    padded = np.pad(labels, 1)
    nodes, starts, left, right, loops = _trace(padded)
    across = labels.shape[1] + 1
    return Outlines(np.column_stack([nodes % across, nodes // across]).astype(np.float64), starts, left, right, loops)


def smooth(outlines: Outlines, passes: int) -> Outlines:
    """Low-pass filter each arc with the mask (1, 2, 1) / 4, `passes` times; fewer times on short arcs and small loops.

    Junctions are fixed, so neighbours still meet, and the frame's border stays straight. Loops have no fixed point and
    shrink; with at most one pass per 8 edges they shrink little.
    """
    points = _smooth(outlines.points, outlines.starts, outlines.loops, passes)
    return Outlines(points, outlines.starts, outlines.left, outlines.right, outlines.loops)


def follow(outlines: Outlines, borders: Borders) -> Outlines:
    """The arcs along smoothed borders of the same label map, so that both draw the same curves.

    Points without a node of `borders`, on the frame's straight sides, stay where they are.
    """
    across = borders.size[0] + 1
    points = outlines.points.copy()
    nodes = np.full(across * (borders.size[1] + 1), -1, np.int32)
    nodes[borders.lattice[:, 1] * across + borders.lattice[:, 0]] = np.arange(len(borders.lattice), dtype=np.int32)
    node = nodes[(points[:, 1] * across + points[:, 0]).astype(np.int64)]
    points[node >= 0] = borders.positions[node[node >= 0]]
    return Outlines(points, outlines.starts, outlines.left, outlines.right, outlines.loops)


def simplify(outlines: Outlines, tolerance_px: float) -> Outlines:
    """Remove the points of each arc that lie within `tolerance_px` of the simplified arc (Douglas and Peucker 1973).

    A tolerance of 0 removes only points in the middle of straight lines, and the shape is unchanged.
    """
    keep = _simplify(outlines.points, outlines.starts, tolerance_px)
    counts = np.concatenate([[0], np.cumsum(keep)])
    return Outlines(outlines.points[keep], counts[outlines.starts], outlines.left, outlines.right, outlines.loops)


def rings(outlines: Outlines) -> dict[int, list[list[tuple[int, bool]]]]:
    """Closed boundaries of each label, each a chain of (arc, reversed), with the label on its left.

    Where a label touches itself at a corner, its rings can be joined in several ways; with the even-odd rule, all of
    them fill the same area.
    """
    out: dict[int, dict[tuple[float, float], list[tuple[int, bool]]]] = {}
    first, last = _ends(outlines)
    for arc, (left, right) in enumerate(zip(outlines.left.tolist(), outlines.right.tolist(), strict=True)):
        out.setdefault(left, {}).setdefault(first[arc], []).append((arc, False))
        out.setdefault(right, {}).setdefault(last[arc], []).append((arc, True))
    return {label: _chains(out[label], first, last) for label in sorted(out) if label > 0}


_Ends = list[tuple[float, float]]


def _ends(outlines: Outlines) -> tuple[_Ends, _Ends]:
    first = outlines.points[outlines.starts[:-1]].tolist()
    last = outlines.points[outlines.starts[1:] - 1].tolist()
    return [(x, y) for x, y in first], [(x, y) for x, y in last]


def _chains(
    leaving: dict[tuple[float, float], list[tuple[int, bool]]], first: _Ends, last: _Ends
) -> list[list[tuple[int, bool]]]:
    """Join half arcs to closed chains. As many enter a node as leave it, so a walk ends only where it began."""
    found = []
    for origin in list(leaving):
        while leaving[origin]:
            chain, node = [], origin
            while leaving.get(node):
                arc, backwards = leaving[node].pop()
                chain.append((arc, backwards))
                node = first[arc] if backwards else last[arc]
            found.append(chain)
    return found


@kernel
def _edges_at(padded: Labels, x: int, y: int) -> int:
    """Boundary edges at a node as bits: 1 = right, 2 = down, 4 = left, 8 = up."""
    nw, ne = padded[y, x], padded[y, x + 1]
    sw, se = padded[y + 1, x], padded[y + 1, x + 1]
    return int((ne != se) * 1 + (sw != se) * 2 + (nw != sw) * 4 + (nw != ne) * 8)


@kernel
def _is_junction(padded: Labels, x: int, y: int) -> bool:
    bits = _edges_at(padded, x, y)
    degree = (bits & 1) + (bits >> 1 & 1) + (bits >> 2 & 1) + (bits >> 3 & 1)
    corner = (x == 0 or x == padded.shape[1] - 2) and (y == 0 or y == padded.shape[0] - 2)
    return degree > 2 or (corner and degree > 0)


@kernel
def _walk(
    padded: Labels, done: NDArray[np.uint8], x: int, y: int, direction: int, nodes: NDArray[np.int64], size: int
) -> int:
    """Follow edges from (x, y) in a direction (0 right, 1 down, 2 left, 3 up) to a junction or to the start.

    Writes the nodes from index `size` on, and returns the index after the last one.
    """
    across = padded.shape[1] - 1
    origin = y * across + x
    nodes[size] = origin
    size += 1
    while True:
        done[y, x] |= 1 << direction
        x += (direction == 0) - (direction == 2)
        y += (direction == 1) - (direction == 3)
        back = (direction + 2) % 4
        done[y, x] |= 1 << back
        nodes[size] = y * across + x
        size += 1
        if nodes[size - 1] == origin or _is_junction(padded, x, y):
            return size
        onward = _edges_at(padded, x, y) & ~(1 << back)
        direction = 0
        while not onward >> direction & 1:
            direction += 1


@kernel
def _sides(padded: Labels, x: int, y: int, direction: int) -> tuple[int, int]:
    """Labels to the left and right of the edge that leaves the node in a direction."""
    nw, ne = padded[y, x], padded[y, x + 1]
    sw, se = padded[y + 1, x], padded[y + 1, x + 1]
    if direction == 0:
        return ne, se
    if direction == 1:
        return se, sw
    if direction == 2:
        return sw, nw
    return nw, ne


@kernel
def _trace(
    padded: Labels,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_]]:
    height, width = padded.shape[0] - 1, padded.shape[1] - 1
    edges = 0
    for y in range(height):
        for x in range(width):
            edges += (_edges_at(padded, x, y) & 1) + (_edges_at(padded, x, y) >> 1 & 1)
    nodes = np.empty(2 * edges, np.int64)
    starts = np.zeros(edges + 1, np.int64)
    left, right = np.empty(edges, np.int32), np.empty(edges, np.int32)
    loops = np.zeros(edges, np.bool_)
    done = np.zeros((height, width), np.uint8)
    arcs = size = 0
    for looping in range(2):  # arcs between junctions first; the remaining edges form loops
        for y in range(height):
            for x in range(width):
                bits = _edges_at(padded, x, y)
                if bits == 0 or (looping == 0 and not _is_junction(padded, x, y)):
                    continue
                for direction in range(4):
                    if bits >> direction & 1 and not done[y, x] >> direction & 1:
                        left[arcs], right[arcs] = _sides(padded, x, y, direction)
                        loops[arcs] = looping == 1
                        size = _walk(padded, done, x, y, direction, nodes, size)
                        arcs += 1
                        starts[arcs] = size
    return nodes[:size].copy(), starts[: arcs + 1].copy(), left[:arcs].copy(), right[:arcs].copy(), loops[:arcs].copy()


@kernel
def _smooth(points: Points, starts: NDArray[np.int64], loops: NDArray[np.bool_], passes: int) -> Points:
    now = points.copy()
    for arc in range(starts.size - 1):
        begin, end = starts[arc], starts[arc + 1] - 1  # indices of the first and the last point
        for _ in range(min(passes, (end - begin) // (8 if loops[arc] else 2))):
            for axis in range(2):
                first = before = now[begin, axis]
                if loops[arc]:
                    now[begin, axis] = 0.25 * now[end - 1, axis] + 0.5 * first + 0.25 * now[begin + 1, axis]
                for i in range(begin + 1, end):
                    here = now[i, axis]
                    following = first if loops[arc] and i + 1 == end else now[i + 1, axis]
                    now[i, axis] = 0.25 * before + 0.5 * here + 0.25 * following
                    before = here
                if loops[arc]:
                    now[end, axis] = now[begin, axis]
    return now


@kernel
def _distance(points: Points, i: int, a: int, b: int) -> float:
    """Distance of point i to the segment between points a and b."""
    ax, ay = points[a, 0], points[a, 1]
    dx, dy = points[b, 0] - ax, points[b, 1] - ay
    px, py = points[i, 0] - ax, points[i, 1] - ay
    square = dx * dx + dy * dy
    along = 0.0 if square == 0.0 else min(max((px * dx + py * dy) / square, 0.0), 1.0)
    return float(np.hypot(px - along * dx, py - along * dy))


@kernel
def _simplify(points: Points, starts: NDArray[np.int64], tolerance: float) -> NDArray[np.bool_]:
    keep = np.zeros(points.shape[0], np.bool_)
    stack = np.empty((points.shape[0] + 1, 2), np.int64)
    for arc in range(starts.size - 1):
        keep[starts[arc]] = keep[starts[arc + 1] - 1] = True
        stack[0, 0], stack[0, 1] = starts[arc], starts[arc + 1] - 1
        depth = 1
        while depth > 0:
            depth -= 1
            a, b = stack[depth, 0], stack[depth, 1]
            farthest, split = tolerance, -1
            for i in range(a + 1, b):
                distance = _distance(points, i, a, b)
                if distance > farthest:
                    farthest, split = distance, i
            if split >= 0:
                keep[split] = True
                stack[depth, 0], stack[depth, 1] = a, split
                stack[depth + 1, 0], stack[depth + 1, 1] = split, b
                depth += 2
    return keep
