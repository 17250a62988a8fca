"""Outlines as approximate signed distance functions: negative inside, positive outside.

Each takes and returns float64 arrays of the same shape; lengths are in the cut-out's units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import TypeAlias

import numpy as np

from pipeline.scenes.pose import Array

Outline: TypeAlias = Callable[[Array, Array], Array]


def everywhere(x: Array, y: Array) -> Array:
    """Unbounded shape that covers the whole plane, for backdrops."""
    return np.full(np.broadcast_shapes(x.shape, y.shape), -1.0)


def disc(cx: float, cy: float, radius: float) -> Outline:
    return lambda x, y: np.hypot(x - cx, y - cy) - radius


def ellipse(cx: float, cy: float, rx: float, ry: float) -> Outline:
    """An ellipse. The distance is accurate only near the outline."""

    def outline(x: Array, y: Array) -> Array:
        u, v = (x - cx) / rx, (y - cy) / ry
        length = np.hypot(u, v)
        return (length - 1.0) * length / np.maximum(np.hypot(u / rx, v / ry), 1e-9)

    return outline


def box(cx: float, cy: float, half_width: float, half_height: float, corner: float = 0.0) -> Outline:
    """A rectangle with corners rounded by the radius `corner`."""

    def outline(x: Array, y: Array) -> Array:
        u, v = np.abs(x - cx) - half_width + corner, np.abs(y - cy) - half_height + corner
        return np.hypot(np.maximum(u, 0), np.maximum(v, 0)) + np.minimum(np.maximum(u, v), 0) - corner

    return outline


def polygon(*corners: tuple[float, float], corner: float = 0.0) -> Outline:
    """A simple polygon, expanded by `corner`, which also rounds its corners."""
    points = np.asarray(corners, dtype=np.float64)
    edges = list(zip(points, np.roll(points, -1, axis=0), strict=True))

    def outline(x: Array, y: Array) -> Array:
        nearest, odd = np.full(x.shape, np.inf), np.zeros(x.shape, dtype=bool)
        for start, end in edges:
            nearest = np.minimum(nearest, _to_segment(x, y, start, end))
            odd ^= _crosses(x, y, start, end)
        return np.asarray(np.where(odd, -1.0, 1.0) * np.sqrt(nearest) - corner)

    return outline


def _to_segment(x: Array, y: Array, start: Array, end: Array) -> Array:
    """Squared distance to a segment."""
    along = end - start
    t = np.clip(((x - start[0]) * along[0] + (y - start[1]) * along[1]) / (along @ along), 0, 1)
    squared: Array = (x - start[0] - t * along[0]) ** 2 + (y - start[1] - t * along[1]) ** 2
    return squared


def _crosses(x: Array, y: Array, start: Array, end: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Whether a ray to the right crosses the segment."""
    if start[1] == end[1]:
        return np.zeros(x.shape, dtype=bool)
    between = (start[1] > y) != (end[1] > y)
    hit = start[0] + (y - start[1]) * (end[0] - start[0]) / (end[1] - start[1])
    return np.asarray(between & (x < hit))


def star(points: int, outer: float, inner: float, corner: float = 0.0) -> Outline:
    """A star about the origin, one point up."""
    angles = np.arange(2 * points) * np.pi / points
    radii = np.where(np.arange(2 * points) % 2, inner, outer)
    return polygon(
        *((float(r * np.sin(a)), float(-r * np.cos(a))) for a, r in zip(angles, radii, strict=True)), corner=corner
    )


def above(level: Callable[[Array], Array]) -> Outline:
    """The area below a skyline: y > level(x)."""
    return lambda x, y: level(x) - y


def union(*outlines: Outline) -> Outline:
    return lambda x, y: reduce(np.minimum, (o(x, y) for o in outlines))


def common(*outlines: Outline) -> Outline:
    """Intersection of the outlines."""
    return lambda x, y: reduce(np.maximum, (o(x, y) for o in outlines))


def without(outline: Outline, hole: Outline) -> Outline:
    return lambda x, y: np.maximum(outline(x, y), -hole(x, y))


def blobs(discs: Sequence[tuple[float, float, float]], soft: float) -> Outline:
    """Smooth union of discs (cx, cy, radius); `soft` is the blending distance."""

    def outline(x: Array, y: Array) -> Array:
        total = np.zeros(np.broadcast_shapes(x.shape, y.shape))
        for cx, cy, radius in discs:
            total += np.exp(-np.clip((np.hypot(x - cx, y - cy) - radius) / soft, -40, 40))
        return -soft * np.log(total + 1e-30)

    return outline
