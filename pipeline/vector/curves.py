"""Cubic Bezier curves along the arcs of region boundaries (schneider1990fitting).

Both regions beside an arc use the same curves, one of them backwards, so neighbours meet without gap or overlap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.vector.outlines import Outlines, Points

_REFINEMENTS = 4
"""Newton steps that move the points' parameters along a curve before the curve is split."""
_WORTH_REFINING = 16.0
"""Squared error in units of the squared tolerance above which a curve is split at once."""
_TANGENT_POINTS = 3
"""Points from which the direction at the end of an arc is measured: one lattice step may be noise."""


def fit_curves(outlines: Outlines, tolerance_px: float) -> Outlines:
    """Replace the polylines of each arc by cubic Bezier curves through some of their points: outlines of degree 3.

    Curves of one arc join with the same tangent. A curve that misses a point by more than the tolerance is split there.

    Args:
        outlines: of degree 1, smoothed.
        tolerance_px: largest distance of an arc's points from its curves, px; > 0.
    """
    counts = np.zeros(len(outlines.starts), np.int64)
    control = np.empty((3 * len(outlines.points) + len(counts), 2))
    _fit_arcs(outlines.points, outlines.starts, outlines.loops, tolerance_px**2, control, counts)
    starts = np.cumsum(counts)
    return replace(outlines, points=control[: starts[-1]].copy(), starts=starts, degree=3)


@kernel
def _fit_arcs(
    points: Points, starts: NDArray[np.int64], loops: NDArray[np.bool_], tolerance: float, control: Points,
    counts: NDArray[np.int64],
) -> None:  # fmt: skip
    """Write control points, and to `counts[i + 1]` their number for arc i. `tolerance` is squared."""
    used = 0
    stack = np.empty((points.shape[0] + 1, 6))
    for arc in range(starts.size - 1):
        begin, end = starts[arc], starts[arc + 1] - 1
        first, last = _end_tangents(points, begin, end, loops[arc])
        before = used
        control[used] = points[begin]
        used += 1
        depth = 1
        stack[0, 0], stack[0, 1], stack[0, 2:4], stack[0, 4:6] = begin, end, first, last
        while depth > 0:
            depth -= 1
            a, b = int(stack[depth, 0]), int(stack[depth, 1])
            leave, arrive = stack[depth, 2:4].copy(), stack[depth, 4:6].copy()
            curve, split = _fit(points, a, b, leave, arrive, tolerance)
            if split < 0:
                control[used : used + 3] = curve[1:]
                used += 3
                continue
            middle = _direction(points[max(split - 2, a)], points[min(split + 2, b)])
            stack[depth, 0], stack[depth, 1], stack[depth, 2:4], stack[depth, 4:6] = split, b, middle, arrive
            stack[depth + 1, 0], stack[depth + 1, 1] = a, split
            stack[depth + 1, 2:4], stack[depth + 1, 4:6] = leave, -middle
            depth += 2
        counts[arc + 1] = used - before


@kernel
def _end_tangents(points: Points, begin: int, end: int, loop: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors from the first and from the last point into the arc; opposite directions on a loop."""
    if loop:
        along = _direction(points[max(end - 2, begin)], points[min(begin + 2, end)])
        return along, -along
    reach = min(_TANGENT_POINTS, end - begin)
    return _direction(points[begin], points[begin + reach]), _direction(points[end], points[end - reach])


@kernel
def _direction(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vector from a to b; (0, 0) if they are equal."""
    d = b - a
    return np.asarray(d / max(np.hypot(d[0], d[1]), 1e-12), np.float64)


@kernel
def _fit(
    points: Points, a: int, b: int, leave: NDArray[np.float64], arrive: NDArray[np.float64], tolerance: float
) -> tuple[Points, int]:
    """A curve from point a to point b, (4, 2), and the index of the point at which it must be split, or -1."""
    curve = np.empty((4, 2))
    curve[0], curve[3] = points[a], points[b]
    if b - a < 2:
        curve[1], curve[2] = points[a] + (points[b] - points[a]) / 3, points[b] - (points[b] - points[a]) / 3
        return curve, -1
    where = _chord_lengths(points, a, b)
    for _ in range(_REFINEMENTS + 1):
        _least_squares(points, a, b, where, leave, arrive, curve)
        error, split = 0.0, a + 1
        for i in range(a + 1, b):
            p = _at(curve, where[i - a])
            square = (p[0] - points[i, 0]) ** 2 + (p[1] - points[i, 1]) ** 2
            if square > error:
                error, split = square, i
        if error <= tolerance:
            return curve, -1
        if error > tolerance * _WORTH_REFINING:
            break
        for i in range(a + 1, b):
            where[i - a] = _nearer(curve, where[i - a], points[i])
    return curve, split


@kernel
def _chord_lengths(points: Points, a: int, b: int) -> NDArray[np.float64]:
    """Parameters 0..1 of the points a to b, proportional to the length of the polyline."""
    where = np.zeros(b - a + 1)
    for i in range(a + 1, b + 1):
        where[i - a] = where[i - a - 1] + np.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return np.asarray(where / max(where[-1], 1e-12), np.float64)


@kernel
def _least_squares(
    points: Points, a: int, b: int, where: NDArray[np.float64], leave: NDArray[np.float64],
    arrive: NDArray[np.float64], curve: Points,
) -> None:  # fmt: skip
    """Set the inner control points, on the end tangents, so that the curve is nearest to the points."""
    c00 = c01 = c11 = x0 = x1 = 0.0
    across = leave[0] * arrive[0] + leave[1] * arrive[1]
    for i in range(a + 1, b):
        u = where[i - a]
        v = 1 - u
        b0, b1, b2, b3 = v * v * v, 3 * u * v * v, 3 * u * u * v, u * u * u
        rx = points[i, 0] - (b0 + b1) * curve[0, 0] - (b2 + b3) * curve[3, 0]
        ry = points[i, 1] - (b0 + b1) * curve[0, 1] - (b2 + b3) * curve[3, 1]
        c00 += b1 * b1
        c01 += b1 * b2 * across
        c11 += b2 * b2
        x0 += b1 * (rx * leave[0] + ry * leave[1])
        x1 += b2 * (rx * arrive[0] + ry * arrive[1])
    det = c00 * c11 - c01 * c01
    chord = np.hypot(curve[3, 0] - curve[0, 0], curve[3, 1] - curve[0, 1])
    alpha = beta = 0.0
    if abs(det) > 1e-12:
        alpha, beta = (x0 * c11 - x1 * c01) / det, (c00 * x1 - c01 * x0) / det
    if not (1e-3 * chord < alpha < 3 * chord and 1e-3 * chord < beta < 3 * chord):
        alpha = beta = chord / 3  # Wu and Barsky's heuristic
    curve[1], curve[2] = curve[0] + alpha * leave, curve[3] + beta * arrive


@kernel
def _at(curve: Points, u: float) -> NDArray[np.float64]:
    v = 1 - u
    cubic = v * v * v * curve[0] + 3 * u * v * v * curve[1] + 3 * u * u * v * curve[2] + u * u * u * curve[3]
    return np.asarray(cubic, np.float64)


@kernel
def _nearer(curve: Points, u: float, point: NDArray[np.float64]) -> float:
    """One Newton step of the parameter towards the curve's nearest place to a point."""
    v = 1 - u
    first = 3 * (v * v * (curve[1] - curve[0]) + 2 * u * v * (curve[2] - curve[1]) + u * u * (curve[3] - curve[2]))
    second = 6 * (v * (curve[2] - 2 * curve[1] + curve[0]) + u * (curve[3] - 2 * curve[2] + curve[1]))
    away = _at(curve, u) - point
    slope = (first * first).sum() + (away * second).sum()
    if slope <= 1e-12:
        return u
    return float(min(max(u - (away * first).sum() / slope, 0.0), 1.0))
