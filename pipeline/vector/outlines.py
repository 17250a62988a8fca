"""The boundaries of a label map as arcs that neighbours share.

Boundaries run on the lattice of pixel corners: (w + 1) x (h + 1) nodes, node (x, y) being the top left corner of pixel
(x, y). A *junction* is a node where other than two boundary edges meet, or a corner of the frame; an *arc* is the chain
of edges between two junctions, or a loop without any. Whatever is done to an arc is done to both its neighbours at
once, so no gap and no overlap can open between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.jit import kernel

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Outlines:
    """Arcs, one after the other. Corner coordinates: the frame spans (0, 0) to (width, height)."""

    points: Points
    """(n, 2): x, y in px. An arc's first and last points are junctions, or the same point of a loop."""
    starts: NDArray[np.int64]
    """(arcs + 1,): arc i is points[starts[i]:starts[i + 1]]."""
    left: NDArray[np.int32]
    """(arcs,): the label to the left of one who walks the arc (on a screen, y down); 0 = none."""
    right: NDArray[np.int32]
    loops: NDArray[np.bool_]
    """(arcs,): whether the arc has no junction."""


def trace(labels: Labels) -> Outlines:
    """The arcs between the labels of a map; 0 and all that lies outside the frame count as one.

    Args:
        labels: int32 (height, width), 0 = no label.
    """
    padded = np.pad(labels, 1)
    nodes, starts, left, right, loops = _trace(padded)
    across = labels.shape[1] + 1
    return Outlines(np.column_stack([nodes % across, nodes // across]).astype(np.float64), starts, left, right, loops)


def smooth(outlines: Outlines, passes: int) -> Outlines:
    """Low-pass every arc with the mask (1, 2, 1) / 4, `passes` times, fewer on short ones and on small loops.

    Junctions stay where they are, so neighbours still meet; the frame's straight border stays straight. A loop has
    nothing to hold on to and shrinks, by little at no more than one pass for every 8 edges.
    """
    points = _smooth(outlines.points, outlines.starts, outlines.loops, passes)
    return Outlines(points, outlines.starts, outlines.left, outlines.right, outlines.loops)


def simplify(outlines: Outlines, tolerance_px: float) -> Outlines:
    """Drop the points of every arc that lie within `tolerance_px` of what remains (Douglas and Peucker 1973).

    At 0 only points in the middle of straight runs go, and the shape stays the same.
    """
    keep = _simplify(outlines.points, outlines.starts, tolerance_px)
    counts = np.concatenate([[0], np.cumsum(keep)])
    return Outlines(outlines.points[keep], counts[outlines.starts], outlines.left, outlines.right, outlines.loops)


def rings(outlines: Outlines) -> dict[int, list[list[tuple[int, bool]]]]:
    """Every label's closed boundaries, each a chain of (arc, reversed), the label on its left.

    Where a label touches itself at a corner, its rings may be joined there in one of several ways; filled by the
    even-odd rule, all cover the same.
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
    """Use up every half arc. As many enter a node as leave it, so a walk can only get stuck where it began."""
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
    """Bits 1, 2, 4, 8: a boundary edge leaves the node to the right, down, left, up."""
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
    padded: Labels, done: NDArray[np.uint8], x: int, y: int, way: int, nodes: NDArray[np.int64], size: int
) -> int:
    """Follow edges from (x, y) by `way` (0 right, 1 down, 2 left, 3 up) to a junction or back to where it began."""
    across = padded.shape[1] - 1
    origin = y * across + x
    nodes[size] = origin
    size += 1
    while True:
        done[y, x] |= 1 << way
        x += (way == 0) - (way == 2)
        y += (way == 1) - (way == 3)
        back = (way + 2) % 4
        done[y, x] |= 1 << back
        nodes[size] = y * across + x
        size += 1
        if nodes[size - 1] == origin or _is_junction(padded, x, y):
            return size
        onward = _edges_at(padded, x, y) & ~(1 << back)
        way = 0
        while not onward >> way & 1:
            way += 1


@kernel
def _sides(padded: Labels, x: int, y: int, way: int) -> tuple[int, int]:
    """Labels to the left and right of the edge that leaves the node by `way`."""
    nw, ne = padded[y, x], padded[y, x + 1]
    sw, se = padded[y + 1, x], padded[y + 1, x + 1]
    if way == 0:
        return ne, se
    if way == 1:
        return se, sw
    if way == 2:
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
    for looping in range(2):  # junctions first: what they leave are the loops
        for y in range(height):
            for x in range(width):
                bits = _edges_at(padded, x, y)
                if bits == 0 or (looping == 0 and not _is_junction(padded, x, y)):
                    continue
                for way in range(4):
                    if bits >> way & 1 and not done[y, x] >> way & 1:
                        left[arcs], right[arcs] = _sides(padded, x, y, way)
                        loops[arcs] = looping == 1
                        size = _walk(padded, done, x, y, way, nodes, size)
                        arcs += 1
                        starts[arcs] = size
    return nodes[:size].copy(), starts[: arcs + 1].copy(), left[:arcs].copy(), right[:arcs].copy(), loops[:arcs].copy()


@kernel
def _smooth(points: Points, starts: NDArray[np.int64], loops: NDArray[np.bool_], passes: int) -> Points:
    now = points.copy()
    for arc in range(starts.size - 1):
        begin, end = starts[arc], starts[arc + 1] - 1  # of the first and of the last point
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
    """From point i to the segment between points a and b."""
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
