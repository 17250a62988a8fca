"""Width and opacity of curves: wide where the line is strong, tapered at free ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.lines.fairing import fair
from pipeline.lines.linking import Curves, Index
from pipeline.lines.past import nearest, sample, smooth_along
from pipeline.lines.pen import Strokes
from pipeline.lines.ridges import Points

_TANH = np.tanh(np.arange(1025) / 256).astype(np.float32)
"""tanh of 0..4 in steps of 1/256."""


class InkParams(NamedTuple):
    """Constants of inking. Lengths are px of the plane or multiples of the sigma of the narrower Gaussian."""

    width: np.float32 = np.float32(1.0)
    """Factor on the half width of the ridge."""
    shift: np.float32 = np.float32(0.8)
    """By how far a line moves from the dark side of an edge onto it, in sigmas; the ridge lies 1.25 beside the edge."""
    beside: np.float32 = np.float32(2.5)
    """Distance from the ridge at which its bright side is recognised, in sigmas."""
    taper: np.float32 = np.float32(7)
    """Length, in sigmas, over which a free end tapers."""
    anchor: int = 3
    """Distance, px along either axis, from which an end is moved onto another curve."""
    margin: np.float32 = np.float32(2.5)
    """Distance from the border of the frame from which an end is moved outside, px."""


INKING = InkParams()


def ink_curves(
    points: Points, curves: Curves, response: Plane, sigma_px: Plane, sharpness: float, widest_px: float,
    removed: NDArray[np.float32],
) -> Strokes:  # fmt: skip
    """The strokes of curves, px of the plane.

    Args:
        points: of all curves, the ridges of `response`.
        sigma_px: float32 (h, w), standard deviation of the narrower Gaussian.
        sharpness: 1/gray level; the opacity is tanh(sharpness * (response - threshold)) (winnemoeller2006realtime,
            eq. 6).
        widest_px: largest half width of a line: wider dark stripes are regions.
        removed: float32 (points of the curves,), share of the ink that is not drawn, 0..1.
    """
    places = np.column_stack([points["x"][curves.order], points["y"][curves.order]])
    _shift_to_edges(points, curves, response, sigma_px, places)
    places = fair(places, curves.starts)
    widths, opacities = np.empty(len(places), np.float32), np.empty(len(places), np.float32)
    _weigh(points, curves, np.float32(sharpness), np.float32(widest_px), _TANH, widths, opacities)
    opacities *= 1 - removed
    smooth_along(opacities, curves.starts)
    _finish_ends(places, curves.starts, sigma_px, widths)
    return Strokes(places + np.float32(0.5), widths, opacities, curves.starts)


@kernel
def _weigh(
    points: Points, curves: Curves, sharpness: np.float32, widest: np.float32, tanh: NDArray[np.float32],
    widths: NDArray[np.float32], opacities: NDArray[np.float32],
) -> None:  # fmt: skip
    order, starts = curves.order, curves.starts
    excess, measured = np.empty(order.size, np.float32), np.empty(order.size, np.float32)
    for n in range(order.size):
        point = points[order[n]]
        excess[n] = point["response"] - point["threshold"]
        measured[n] = min(INKING.width * point["half_width"], widest)
    smooth_along(excess, starts)
    smooth_along(measured, starts)
    for k in range(starts.size - 1):
        for n in range(starts[k], starts[k + 1]):
            point = points[order[n]]
            over = max(excess[n], np.float32(0))
            share = over / max(over + point["threshold"], np.float32(1e-3))
            widths[n] = measured[n] * np.sqrt(share)
            step = np.int32(min(over * sharpness * np.float32(256), np.float32(1024)))
            opacities[n] = tanh[step]


@kernel
def _shift_to_edges(
    points: Points, curves: Curves, response: Plane, sigma_px: Plane, places: NDArray[np.float32]
) -> None:  # fmt: skip
    """Move lines on the dark side of an edge towards it, in place. A dark stripe has two bright sides, and stays."""
    order, starts = curves.order, curves.starts
    shifts, normals = np.zeros(len(places), np.float32), np.zeros_like(places)
    for k in range(starts.size - 1):
        for n in range(starts[k], starts[k + 1]):
            point, (x, y) = points[order[n]], places[n]
            sign = _direction(points, order, point, n, starts[k], starts[k + 1] - 1)
            normals[n, 0], normals[n, 1] = -sign * point["along_y"], sign * point["along_x"]
            sigma, own = nearest(sigma_px, x, y), point["response"]
            for way in (-1, 1):
                step = np.float32(way) * INKING.beside * sigma
                beside = sample(response, x + step * normals[n, 0], y + step * normals[n, 1])
                shifts[n] += np.float32(way) * INKING.shift * sigma * _is_bright(-beside / own)
    smooth_along(shifts, starts)
    for n in range(len(places)):
        places[n, 0] += shifts[n] * normals[n, 0]
        places[n, 1] += shifts[n] * normals[n, 1]


@kernel
def _direction(
    points: Points, order: NDArray[np.int32], point: np.void, n: int, first: int, last: int
) -> np.float32:  # fmt: skip
    """1 if the curve passes the point in the direction of its ridge, -1 if backwards."""
    one, two = points[order[max(n - 1, first)]], points[order[min(n + 1, last)]]
    along = (two["x"] - one["x"]) * point["along_x"] + (two["y"] - one["y"]) * point["along_y"]
    return np.float32(1) if along >= 0 else np.float32(-1)


@kernel
def _is_bright(fall: np.float32) -> np.float32:
    """Whether a side of a ridge, with its negative response as a share of the ridge's, is the bright side of an edge,
    0..1; 0 for a thin bright stripe, which has two edges."""
    return max(min(min(fall, np.float32(1)), np.float32(2) - fall), np.float32(0))


@kernel
def _finish_ends(places: NDArray[np.float32], starts: Index, sigma_px: Plane, widths: NDArray[np.float32]) -> None:
    """Move ends near other curves onto them, ends near the border of the frame outside, and taper the other ends."""
    height, width = sigma_px.shape
    owner = np.full(sigma_px.shape, -1, np.int32)
    for k in range(starts.size - 1):
        for n in range(starts[k], starts[k + 1]):
            x, y = int(np.rint(places[n, 0])), int(np.rint(places[n, 1]))
            if 0 <= x < width and 0 <= y < height:
                owner[y, x] = n
    for k in range(starts.size - 1):
        begin, end = starts[k], starts[k + 1]
        first, last = places[begin], places[end - 1]
        if first[0] == last[0] and first[1] == last[1]:
            continue  # a loop
        for way in (1, -1):
            tip = begin if way > 0 else end - 1
            if not (_reach_border(places, tip, way, width, height) or _anchor(places, owner, tip, begin, end)):
                _taper(places, widths, tip, way, end - begin, sigma_px)


@kernel
def _reach_border(places: NDArray[np.float32], tip: int, way: int, width: int, height: int) -> bool:
    x, y = places[tip, 0], places[tip, 1]
    near = min(min(x, y), min(width - 1 - x, height - 1 - y)) < INKING.margin
    if near:
        inner = tip + way
        dx, dy = x - places[inner, 0], y - places[inner, 1]
        length = max(np.sqrt(dx * dx + dy * dy), np.float32(1e-6))
        places[tip, 0] += dx / length * (INKING.margin + np.float32(1))
        places[tip, 1] += dy / length * (INKING.margin + np.float32(1))
    return bool(near)


@kernel
def _anchor(places: NDArray[np.float32], owner: Index, tip: int, begin: int, end: int) -> bool:
    """Move an end onto the nearest point of another curve, if there is one within reach."""
    height, width = owner.shape
    column, row = int(np.rint(places[tip, 0])), int(np.rint(places[tip, 1]))
    least, best = np.float32(1e9), -1
    for v in range(max(row - INKING.anchor, 0), min(row + INKING.anchor + 1, height)):
        for u in range(max(column - INKING.anchor, 0), min(column + INKING.anchor + 1, width)):
            n = owner[v, u]
            if n < 0 or begin <= n < end:
                continue
            dx, dy = places[n, 0] - places[tip, 0], places[n, 1] - places[tip, 1]
            if dx * dx + dy * dy < least:
                least, best = dx * dx + dy * dy, n
    if best >= 0:
        places[tip] = places[best]
    return best >= 0


@kernel
def _taper(
    places: NDArray[np.float32], widths: NDArray[np.float32], tip: int, way: int, count: int, sigma_px: Plane
) -> None:
    length, gone = INKING.taper * nearest(sigma_px, places[tip, 0], places[tip, 1]), np.float32(0)
    length = min(length, np.float32(count) / np.float32(3))
    n = tip
    for _ in range(count):
        if gone >= length:
            return
        widths[n] *= np.sqrt((gone + np.float32(0.3)) / (length + np.float32(0.3)))
        n += way
        if n < 0 or n >= len(places):
            return
        dx, dy = places[n, 0] - places[n - way, 0], places[n, 1] - places[n - way, 1]
        gone += np.sqrt(dx * dx + dy * dy)
