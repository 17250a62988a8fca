"""Curves from the points of ridges: each point is linked to the best one on either side of it, if the choice is mutual.

The result does not depend on the order of the points. Ends that face each other across a gap are joined in the same
way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.lines.ridges import Points

Index = NDArray[np.int32]


class LinkParams(NamedTuple):
    """Constants of linking."""

    reach: int = 2
    """Distance in which the next point is searched, px along either axis."""
    least_cosine: np.float32 = np.float32(0.7)
    """Cosine of the largest angle between a link and the directions of its two points."""
    turn_cost: np.float32 = np.float32(2)
    """Cost of a link, px, by which the sine of the angles at its ends counts."""
    gap: int = 9
    """Longest gap that is joined, px along either axis."""
    gap_share: float = 0.25
    """The same as a share of the shorter curve."""
    least_gap_cosine: np.float32 = np.float32(0.9)
    """`least_cosine` across a gap."""
    end_points: int = 5
    """Number of points from which the direction of a curve's end is measured."""


LINKS = LinkParams()


class Curves(NamedTuple):
    """Curves through points.

    Attributes:
        order: int32 (m,), the points of all curves, curve after curve.
        starts: int32 (curves + 1,): curve i is order[starts[i]:starts[i + 1]].
    """

    order: Index
    starts: Index


def link_points(points: Points, index: Index) -> Curves:
    """Curves through the points of ridges, of at least two points each.

    Args:
        points, index: from `find_ridges`.
    """
    links = np.full((len(points), 2), -1, np.int32)
    _link(points, index, links)
    order, starts = np.empty(2 * len(points), np.int32), np.empty(len(points) + 1, np.int32)
    curves = _traced(links, order, starts)
    if _join_gaps(points, index, curves, links):
        curves = _traced(links, np.empty_like(order), np.empty_like(starts))
    return curves


def _traced(links: Index, order: Index, starts: Index) -> Curves:
    count = _trace(links, order, starts)
    return Curves(order[: starts[count]], starts[: count + 1])


@kernel
def _link(points: Points, index: Index, links: Index) -> None:
    best = np.empty((points.size, 2), np.int32)
    for i in range(points.size):
        best[i, 0], best[i, 1] = _best(points, index, i)
    for i in range(points.size):
        for side in range(2):
            j = best[i, side]
            if j >= 0 and best[j, _side(points, j, i)] == i:
                links[i, side] = j


@kernel
def _best(points: Points, index: Index, i: int) -> tuple[int, int]:
    """The best neighbours of point i on side 0, in its direction, and on side 1; -1 = none."""
    height, width = index.shape
    x, y, along_x, along_y = points[i]["x"], points[i]["y"], points[i]["along_x"], points[i]["along_y"]
    column, row = int(x + np.float32(0.5)), int(y + np.float32(0.5))
    ahead_cost = behind_cost = np.float32(1e9)
    ahead = behind = -1
    for v in range(max(row - LINKS.reach, 0), min(row + LINKS.reach + 1, height)):
        for u in range(max(column - LINKS.reach, 0), min(column + LINKS.reach + 1, width)):
            j = index[v, u]
            if j < 0 or j == i:
                continue
            dx, dy = points[j]["x"] - x, points[j]["y"] - y
            distance = np.sqrt(dx * dx + dy * dy)
            here = dx * along_x + dy * along_y
            there = dx * points[j]["along_x"] + dy * points[j]["along_y"]
            if min(abs(here), abs(there)) <= LINKS.least_cosine * distance:
                continue
            turn = abs(dx * along_y - dy * along_x) + abs(dx * points[j]["along_y"] - dy * points[j]["along_x"])
            cost = distance + LINKS.turn_cost * turn / distance
            if here > 0 and cost < ahead_cost:
                ahead_cost, ahead = cost, j
            elif here < 0 and cost < behind_cost:
                behind_cost, behind = cost, j
    return ahead, behind


@kernel
def _side(points: Points, j: int, i: int) -> int:
    """The side, 0 or 1, of point j on which point i lies."""
    dx, dy = points[i]["x"] - points[j]["x"], points[i]["y"] - points[j]["y"]
    return 0 if dx * points[j]["along_x"] + dy * points[j]["along_y"] > 0 else 1


@kernel
def _trace(links: Index, order: Index, starts: Index) -> int:
    """Write the curves through linked points, first those with ends, then loops; returns their number."""
    done = np.zeros(links.shape[0], np.bool_)
    count = used = 0
    starts[0] = 0
    for loops in range(2):
        for i in range(links.shape[0]):
            ends = np.int64(links[i, 0] >= 0) + np.int64(links[i, 1] >= 0)
            if done[i] or ends != 1 + loops:
                continue
            before, here = -1, i
            while here >= 0 and not done[here]:
                done[here] = True
                order[used] = here
                used += 1
                following = links[here, 0]
                if following < 0 or following == before:
                    following = links[here, 1]
                before, here = here, -1 if following == before else following
            if here == i:  # closes the loop
                order[used] = i
                used += 1
            count += 1
            starts[count] = used
    return count


@kernel
def _join_gaps(points: Points, index: Index, curves: Curves, links: Index) -> bool:
    """Link ends of curves that face each other across a gap; returns whether there are any."""
    order, starts = curves.order, curves.starts
    count = starts.size - 1
    ends = np.empty((2 * count, 3), np.float32)
    of_point = np.full(points.size, -1, np.int32)
    for k in range(count):
        first, last = order[starts[k]], order[starts[k + 1] - 1]
        if links[first, 0] >= 0 and links[first, 1] >= 0:
            continue  # a loop
        inwards = min(LINKS.end_points, starts[k + 1] - starts[k]) - 1
        _set_end(points, first, order[starts[k] + inwards], ends[2 * k])
        _set_end(points, last, order[starts[k + 1] - 1 - inwards], ends[2 * k + 1])
        ends[2 * k, 2] = ends[2 * k + 1, 2] = starts[k + 1] - starts[k]
        of_point[first], of_point[last] = 2 * k, 2 * k + 1
    best = np.full(2 * count, -1, np.int32)
    for end in range(2 * count):
        point = order[starts[end // 2]] if end % 2 == 0 else order[starts[end // 2 + 1] - 1]
        if of_point[point] == end:
            best[end] = _facing(points, index, of_point, ends, point, end)
    joined = False
    for end in range(2 * count):
        other = best[end]
        if other > end and best[other] == end:
            one = order[starts[end // 2]] if end % 2 == 0 else order[starts[end // 2 + 1] - 1]
            two = order[starts[other // 2]] if other % 2 == 0 else order[starts[other // 2 + 1] - 1]
            links[one, 0 if links[one, 0] < 0 else 1] = two
            links[two, 0 if links[two, 0] < 0 else 1] = one
            joined = True
    return joined


@kernel
def _set_end(points: Points, end: int, inner: int, out: NDArray[np.float32]) -> None:
    """Write the unit vector from the inner point to the end."""
    dx, dy = points[end]["x"] - points[inner]["x"], points[end]["y"] - points[inner]["y"]
    length = max(np.sqrt(dx * dx + dy * dy), np.float32(1e-6))
    out[0], out[1] = dx / length, dy / length


@kernel
def _facing(
    points: Points, index: Index, of_point: Index, ends: NDArray[np.float32], point: int, end: int
) -> int:  # fmt: skip
    """The end that best continues an end across a gap, or -1."""
    height, width = index.shape
    x, y = points[point]["x"], points[point]["y"]
    column, row = int(x + np.float32(0.5)), int(y + np.float32(0.5))
    least, best = np.float32(1e9), -1
    gap = min(LINKS.gap, int(_longest_gap(ends[end, 2])))
    for v in range(max(row - gap, 0), min(row + gap + 1, height)):
        for u in range(max(column - gap, 0), min(column + gap + 1, width)):
            j = index[v, u]
            if j < 0 or of_point[j] < 0 or of_point[j] // 2 == end // 2:
                continue
            other = of_point[j]
            dx, dy = points[j]["x"] - x, points[j]["y"] - y
            distance = np.sqrt(dx * dx + dy * dy)
            if distance > _longest_gap(min(ends[end, 2], ends[other, 2])):
                continue
            here, there = dx * ends[end, 0] + dy * ends[end, 1], -(dx * ends[other, 0] + dy * ends[other, 1])
            if min(here, there) <= LINKS.least_gap_cosine * distance:
                continue
            cost = distance + LINKS.turn_cost * (2 * distance - here - there)
            if cost < least:
                least, best = cost, other
    return best


@kernel
def _longest_gap(count: np.float32) -> np.float32:
    """Longest gap, px, that a curve of that many points may have."""
    return np.float32(LINKS.gap_share * count)
