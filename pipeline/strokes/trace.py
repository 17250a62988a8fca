"""Curved strokes: streamlines of an orientation field through each seed, ended where the picture's colour changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.kernels.jit import kernel
from pipeline.strokes.brush import TARGET, Brush, Canvas, Direction, Strokes, discs
from pipeline.strokes.seeds import Points, Seeds, sample

MAX_POINTS = 48
"""Points of the longest stroke; longer strokes take longer steps."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)


@dataclass(frozen=True)
class TraceRules:
    """Rules for the curvature and the ends of streamlines.

    Attributes:
        reference: uint8 (h, w, 3), what is painted. A stroke ends where the picture is further than `edge` from the
            stroke's target colour (Euclidean distance in RGB); None = no limit.
        canvas: float32 (h, w, 7). A stroke also ends where the canvas is nearer to the picture than its own colour.
        min_length: fraction of its requested length up to which a stroke ignores `canvas`, 0..1.
        curvature: 1 = follow the field, towards 0 = stay straight (the filter f_c of hertzmann1998painterly).
    """

    reference: Frame | None = None
    canvas: Canvas | None = None
    edge: float = 90.0
    min_length: float = 0.25
    curvature: float = 1.0


class _Starts(NamedTuple):
    xy: Points
    radius_px: NDArray[np.float32]
    length_px: NDArray[np.float32]
    targets: NDArray[np.float32]


class _Rules(NamedTuple):
    reference: Frame
    canvas: Canvas
    guided: bool
    covered: bool
    edge2: np.float32
    min_length: np.float32
    curvature: np.float32


def trace(
    seeds: Seeds, field: Direction, brush: Brush, targets: NDArray[np.float32], rules: TraceRules | None = None,
    seed: int = 0,
) -> Strokes:  # fmt: skip
    """Trace strokes along the field, half of the length to either side of each seed.

    Args:
        field: float32 (h, w, 2), (cos 2a, sin 2a) times any length; where it is (0, 0) a stroke goes straight on.
        targets: float32 (n, 3), RGB 0..255, target colours of the strokes.
        seed: random seed of the colour jitter.

    Source: hertzmann1998painterly, section 2.2 (steps of one radius, curvature filter, ends by colour); hays2004image,
    section 4 (both ways along an orientation field). Departure: the limit `edge` holds within `min_length` too, so
    that strokes do not cross a silhouette.
    """
    return trace_from(discs(seeds, brush, targets, seed), sample(brush.length_px, seeds.xy), field, rules)


def trace_from(
    starts: Strokes, length_px: NDArray[np.float32], field: Direction, rules: TraceRules | None = None
) -> Strokes:
    """Trace strokes that already have a paint colour.

    Args:
        starts: strokes of one point each, inside the picture (see `discs`).
        length_px: float32 (n,), from tip to tip.
        field, rules: as in `trace`.
    """
    rules = rules or TraceRules()
    guide = np.zeros((1, 1, 3), np.uint8) if rules.reference is None else rules.reference
    under = np.zeros((1, 1, 7), np.float32) if rules.canvas is None else rules.canvas
    steps = np.ceil(length_px * _HALF / np.maximum(starts.radius_px, _ONE)).max(initial=1)
    most = min(2 * int(steps) + 1, MAX_POINTS - 1)
    points, counts = np.empty((len(starts), most, 2), np.float32), np.empty(len(starts), np.int32)
    limits = _Rules(
        guide, under, rules.reference is not None, rules.canvas is not None, np.float32(rules.edge * rules.edge),
        np.float32(rules.min_length), np.float32(rules.curvature),
    )  # fmt: skip
    first = np.ascontiguousarray(starts.points[:, 0])
    _trace(_Starts(first, starts.radius_px, length_px, starts.targets), field, limits, points, counts)
    return replace(starts, points=points, counts=counts)


def trace_along(
    starts: Strokes, length_px: NDArray[np.float32], field: Direction, tangents: NDArray[np.float32]
) -> Strokes:
    """`trace_from` without rules, several times as fast.

    Args:
        tangents: `unit_tangents` of the field.
    """
    steps = np.ceil(length_px * _HALF / np.maximum(starts.radius_px, _ONE)).max(initial=1)
    most = min(2 * int(steps) + 1, MAX_POINTS - 1)
    points, counts = np.empty((len(starts), most, 2), np.float32), np.empty(len(starts), np.int32)
    first = np.ascontiguousarray(starts.points[:, 0])
    _trace_along(_Starts(first, starts.radius_px, length_px, starts.targets), field, tangents, points, counts)
    return replace(starts, points=points, counts=counts)


def unit_tangents(field: Direction, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
    """`tangent` at every pixel, of length 1 and either sign: float32 (h, w, 2); (0, 0) where it is undefined.

    Args:
        out: array for the result; None = a new one.
    """
    out = np.empty_like(field) if out is None else out
    _unit_tangents(field, out)
    return out


@kernel
def _unit_tangents(field: Direction, out: NDArray[np.float32]) -> None:
    """The same operations as in `tangent`, so that bits are the same, without branches, so that the loop vectorises."""
    given, units = field.reshape(-1), out.reshape(-1)
    for pixel in range(len(given) // 2):
        u, v = given[np.uintp(2 * pixel)], given[np.uintp(2 * pixel + 1)]
        length = np.sqrt(u * u + v * v)
        scale = _HALF / length
        large = np.sqrt((length + abs(u)) * scale)
        small = v * scale / large
        tx, ty = (large, small) if u >= _ZERO else (small, large)
        norm = np.sqrt(tx * tx + ty * ty)
        ux, uy = tx / norm, ty / norm
        defined = length > np.float32(1e-6)
        units[np.uintp(2 * pixel)] = ux if defined else _ZERO
        units[np.uintp(2 * pixel + 1)] = uy if defined else _ZERO


@kernel
def _trace_along(
    starts: _Starts, field: Direction, tangents: NDArray[np.float32], points: NDArray[np.float32],
    counts: NDArray[np.int32],
) -> None:  # fmt: skip
    """`_trace` without rules: the directions of its steps are read from `tangents`."""
    height, width = field.shape[:2]
    most = points.shape[1] // 2
    units = tangents.reshape(-1)
    behind, ahead = np.empty((points.shape[1], 2), np.float32), np.empty((points.shape[1], 2), np.float32)
    for k in range(len(starts.xy)):
        reach = starts.length_px[k] * _HALF
        steps = int(np.ceil(reach / max(starts.radius_px[k], _ONE)))
        steps = max(min(steps, most), 1)
        step = reach / np.float32(steps)
        if reach <= _ZERO:
            steps = 0
        px, py = int(starts.xy[k, 0] + _HALF), int(starts.xy[k, 1] + _HALF)
        first_x, first_y = tangent(field[py, px, 0], field[py, px, 1], _ONE, _ZERO)
        # Both sides in turn, step by step: a step waits for the pixel to which the step before has led, and meanwhile
        # the processor computes the other side.
        seed = starts.xy[k, 0], starts.xy[k, 1]
        back, back_way, back_steps, back_open = seed, (-first_x, -first_y), 0, True
        front, front_way, front_steps, front_open = seed, (first_x, first_y), 0, True
        for _ in range(steps):
            if back_open:
                back_open, back, back_way = _stepped(units, (height, width), back, back_way, step)
                if back_open:
                    behind[back_steps, 0], behind[back_steps, 1] = back
                    back_steps += 1
            if front_open:
                front_open, front, front_way = _stepped(units, (height, width), front, front_way, step)
                if front_open:
                    ahead[front_steps, 0], ahead[front_steps, 1] = front
                    front_steps += 1
        for i in range(back_steps):  # the points behind the seed come first, the farthest one foremost
            points[k, i, 0], points[k, i, 1] = behind[back_steps - 1 - i, 0], behind[back_steps - 1 - i, 1]
        points[k, back_steps, 0], points[k, back_steps, 1] = seed
        for i in range(front_steps):
            points[k, back_steps + 1 + i, 0], points[k, back_steps + 1 + i, 1] = ahead[i, 0], ahead[i, 1]
        counts[k] = back_steps + 1 + front_steps


@kernel
def _stepped(
    units: NDArray[np.float32], shape: tuple[int, int], place: tuple[np.float32, np.float32],
    direction: tuple[np.float32, np.float32], step: np.float32,
) -> tuple[bool, tuple[np.float32, np.float32], tuple[np.float32, np.float32]]:  # fmt: skip
    """A step of length `step`, px, along the streamline at `place`, (x, y).

    Args:
        units: `unit_tangents` of the field, flat.
        shape: (height, width) of the picture.
        direction: unit vector of the step before.

    Returns: whether the step ends inside the picture, its end, its direction.
    """
    x, y = place
    dx, dy = direction
    columns, rows = np.float32(shape[1]), np.float32(shape[0])
    # A midpoint step: half an Euler step finds the direction for the whole one.
    mx, my = x + _HALF * step * dx + _HALF, y + _HALF * step * dy + _HALF
    if not (mx >= _ZERO and my >= _ZERO and mx < columns and my < rows):
        return False, place, direction
    at = np.uintp(2 * (int(my) * shape[1] + int(mx)))
    tx, ty = units[at], units[at + np.uintp(1)]
    if tx == _ZERO and ty == _ZERO:  # undefined: straight on
        norm = np.sqrt(dx * dx + dy * dy)
        tx, ty = dx / norm, dy / norm
    elif tx * dx + ty * dy < _ZERO:
        tx, ty = -tx, -ty
    nx, ny = x + step * tx, y + step * ty
    mx, my = nx + _HALF, ny + _HALF
    return mx >= _ZERO and my >= _ZERO and mx < columns and my < rows, (nx, ny), (tx, ty)


@kernel
def tangent(u: np.float32, v: np.float32, back_x: np.float32, back_y: np.float32) -> tuple[np.float32, np.float32]:
    """Unit vector of the angle a of (cos 2a, sin 2a) * length; of the two signs, the one nearer to (back_x, back_y).

    Half-angle formulas are used because they round alike on every processor. Undefined directions give
    (back_x, back_y).
    """
    length = np.sqrt(u * u + v * v)
    if length <= np.float32(1e-6):
        return back_x, back_y
    scale = _HALF / length
    large = np.sqrt((length + abs(u)) * scale)
    small = v * scale / large
    x, y = (large, small) if u >= _ZERO else (small, large)
    if x * back_x + y * back_y < _ZERO:
        return -x, -y
    return x, y


@kernel
def _trace(
    starts: _Starts, field: Direction, rules: _Rules, points: NDArray[np.float32], counts: NDArray[np.int32]
) -> None:
    height, width = field.shape[:2]
    most = points.shape[1] // 2
    reference, canvas, curvature = rules.reference, rules.canvas, rules.curvature
    line = np.empty((2, points.shape[1], 2), np.float32)
    for k in range(len(starts.xy)):
        reach = starts.length_px[k] * _HALF
        steps = int(np.ceil(reach / max(starts.radius_px[k], _ONE)))
        steps = max(min(steps, most), 1)
        step = reach / np.float32(steps)
        ends = np.zeros(2, np.int32)
        if reach <= _ZERO:
            steps = 0
        for side in range(2):
            x, y = starts.xy[k, 0], starts.xy[k, 1]
            px, py = int(x + _HALF), int(y + _HALF)
            dx, dy = tangent(field[py, px, 0], field[py, px, 1], _ONE, _ZERO)
            if side:
                dx, dy = -dx, -dy
            for i in range(steps):
                # A midpoint step: half an Euler step finds the direction for the whole one.
                mx, my = x + _HALF * step * dx, y + _HALF * step * dy
                px, py = int(np.floor(mx + _HALF)), int(np.floor(my + _HALF))
                if px < 0 or py < 0 or px >= width or py >= height:
                    break
                tx, ty = tangent(field[py, px, 0], field[py, px, 1], dx, dy)
                tx = curvature * tx + (_ONE - curvature) * dx
                ty = curvature * ty + (_ONE - curvature) * dy
                norm = np.sqrt(tx * tx + ty * ty)
                if norm <= np.float32(1e-6):
                    break
                dx, dy = tx / norm, ty / norm
                nx, ny = x + step * dx, y + step * dy
                px, py = int(np.floor(nx + _HALF)), int(np.floor(ny + _HALF))
                if px < 0 or py < 0 or px >= width or py >= height:
                    break
                if rules.guided:
                    own, other = _ZERO, _ZERO
                    for c in range(3):
                        wanted = np.float32(reference[py, px, c])
                        own += (wanted - starts.targets[k, c]) * (wanted - starts.targets[k, c])
                        if rules.covered:
                            other += (wanted - canvas[py, px, TARGET + c]) * (wanted - canvas[py, px, TARGET + c])
                    enough = np.float32(i) >= rules.min_length * np.float32(steps)
                    if own > rules.edge2 or (rules.covered and enough and other < own):
                        break
                x, y = nx, ny
                line[side, ends[side], 0] = x
                line[side, ends[side], 1] = y
                ends[side] += 1
        n = 0
        for i in range(ends[1] - 1, -1, -1):
            points[k, n, 0] = line[1, i, 0]  # a copy of a slice takes longer than a step
            points[k, n, 1] = line[1, i, 1]
            n += 1
        points[k, n, 0] = starts.xy[k, 0]
        points[k, n, 1] = starts.xy[k, 1]
        n += 1
        for i in range(ends[0]):
            points[k, n, 0] = line[0, i, 0]
            points[k, n, 1] = line[0, i, 1]
            n += 1
        counts[k] = n
