"""Explicit rasterisation: anti-aliased thick polylines with bristle texture and paint height, painted back to front.

Strokes cover each other, so they are painted one after the other in Numba.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.bristles import BristleArgs, bristle_args, hair, tile
from pipeline.strokes.brush import HEIGHT, TARGET, Canvas, GuideArgs, StrokeArrays, Strokes, guide_args
from pipeline.strokes.random import Ids, Purpose, draws

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_TIP = np.float32(0.3)
"""Fraction of a stroke's length over which either end tapers."""


Profiles: TypeAlias = NDArray[np.float32]
"""Profile of each stroke, `float32` (n, 6): taper at start and end, streaks, dry, soft, bristles (`StrokeProfile`)."""
TAPER_START, TAPER_END, STREAKS, DRY, SOFT, BRISTLES = range(6)
"""Columns of `Profiles`."""


@dataclass(frozen=True)
class StrokeProfile:
    """Shape and texture of strokes.

    Attributes:
        taper: decrease of width at the start and at the end, 0..1 each, over three tenths of the length.
        streaks: amplitude of lightness of the bristle texture at grain 1, gray levels.
        dry: fraction of paint missing between bristles towards the end of a stroke, 0..1, at grain 1.
        soft: width over which the edge of an implicit stroke fades, beyond one pixel, in radii. kagaya2011video names
            softer edges as a reason for lower flicker. Explicit strokes have edges of one pixel.
        bristles: density of the bristle texture: bristles between the centre line and the side of an implicit stroke,
            of which there is at most one a pixel; explicit strokes have a bristle every 0.7 px at 5.
    """

    taper: tuple[float, float] = (0.15, 0.6)
    streaks: float = 36.0
    dry: float = 0.6
    soft: float = 0.18
    bristles: float = 5.0

    def repeated(self, count: int) -> Profiles:
        """The same profile for `count` strokes."""
        return np.tile(
            np.array([*self.taper, self.streaks, self.dry, self.soft, self.bristles], np.float32), (count, 1)
        )


_BRISTLES = np.float32(StrokeProfile.bristles)


class StrokeTrace(NamedTuple):
    """The stroke that is visible at each pixel.

    Attributes:
        owners: uint32 (h, w), the number (`stroke_numbers`) of the last stroke that covers at least half of a pixel.
        cover: float32 (h, w), share of the pixel that strokes cover, 0..1.
    """

    owners: NDArray[np.uint32]
    cover: Plane


def stroke_numbers(ids: Ids) -> NDArray[np.uint32]:
    """Numbers of strokes, uint32 (n,), by which they are told apart in a picture: hashes of their ids, never 0."""
    hashed = (ids * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(32)
    return np.asarray(np.maximum(hashed, np.uint64(1)), np.uint32)


def slopes_of(guide: Frame) -> Plane:
    """Largest change of colour a px around each pixel, RGB distance: float32 (h, w)."""
    around = np.ones((3, 3), np.uint8)
    span = np.asarray(cv2.subtract(cv2.dilate(guide, around), cv2.erode(guide, around)), np.uint8)
    out = np.empty(span.shape[:2], np.float32)
    _half_length(span, out)
    return out


@kernel
def _half_length(vectors: NDArray[np.uint8], out: Plane) -> None:
    height, width = out.shape
    for y in range(height):
        for x in range(width):
            r, g, b = np.int32(vectors[y, x, 0]), np.int32(vectors[y, x, 1]), np.int32(vectors[y, x, 2])
            out[y, x] = np.sqrt(np.float32(r * r + g * g + b * b)) * _HALF


def profiles(profile: StrokeProfile | Profiles | None, count: int) -> Profiles:
    """One profile for each of `count` strokes; `profile`: for all of them, or an array of one row or a row each."""
    if profile is None or isinstance(profile, StrokeProfile):
        return (profile or StrokeProfile()).repeated(count)
    return np.ascontiguousarray(np.broadcast_to(profile, (count, profile.shape[1])), np.float32)


def painting_order(ids: Ids, seed: int = 0) -> NDArray[np.intp]:
    """Random painting order by id, so that two strokes overlap the same way in every frame."""
    return np.argsort(draws(ids, seed, Purpose.ORDER)[:, 0], kind="stable")


def paint(
    canvas: Canvas, strokes: Strokes, *, seed: int = 0, profile: StrokeProfile | Profiles | None = None,
    guide: Frame | None = None, tolerance: float | NDArray[np.float32] = 80.0, slopes: Plane | None = None,
    trace: StrokeTrace | None = None,
) -> Canvas:  # fmt: skip
    """Paint the strokes on the canvas, in place; return it.

    Where a stroke covers the fraction a of a pixel, the pixel becomes old + a * opacity * (stroke - old), for colours
    and paint height.

    Args:
        profile: one for all strokes, or one each; None = defaults.
        guide: uint8 (h, w, 3): strokes do not cover pixels whose guide colour is further than `tolerance` from their
            target colour (Euclidean distance in RGB, with a linear transition over a quarter of it).
        tolerance: one for all strokes, or float32 (n,).
        slopes: float32 (h, w), see `slopes_of`: the transition is at least this wide, so that silhouettes are
            anti-aliased; None = 0.
        trace: is continued, in place; None = not wanted.
    """
    if len(strokes) == 0:
        return canvas
    height, width = canvas.shape[:2]
    traced = trace or StrokeTrace(np.empty((0, 0), np.uint32), np.empty((0, 0), np.float32))
    scratch, rows = np.empty((3, height, width), np.float32), np.empty((height, 2), np.int32)
    scratch[0] = 0  # coverage; the other two planes are read only where a stroke has written them
    _paint(
        canvas, strokes.arrays, painting_order(strokes.ids, seed), bristle_args(tile(seed), strokes.ids, seed),
        guide_args(len(strokes), guide, tolerance, slopes), profiles(profile, len(strokes)),
        (scratch, rows), (traced, stroke_numbers(strokes.ids)),
    )  # fmt: skip
    return canvas


@kernel
def _paint(
    canvas: Canvas, strokes: StrokeArrays, order: NDArray[np.intp], bristles: BristleArgs, guide: GuideArgs,
    profile: Profiles, scratch: tuple[NDArray[np.float32], NDArray[np.int32]],
    traces: tuple[StrokeTrace, NDArray[np.uint32]],
) -> None:  # fmt: skip
    height, width = canvas.shape[:2]
    (planes, rows), (seen, numbers) = scratch, traces
    traced = seen.owners.size > 0
    points = strokes.points
    cover, along, across = planes[0], planes[1], planes[2]
    for k in order:
        n, r = strokes.counts[k], strokes.radius_px[k]
        total = _ZERO
        for i in range(n - 1):
            ax, ay = points[k, i + 1, 0] - points[k, i, 0], points[k, i + 1, 1] - points[k, i, 1]
            total += np.sqrt(ax * ax + ay * ay)
        top, bottom = height, -1
        before = _ZERO
        for i in range(max(n - 1, 1)):
            x0, y0 = points[k, i, 0], points[k, i, 1]
            last = min(i + 1, n - 1)
            ax, ay = points[k, last, 0] - x0, points[k, last, 1] - y0
            length = np.sqrt(ax * ax + ay * ay)
            if length > np.float32(1e-4):
                ax, ay = ax / length, ay / length
            else:
                ax, ay = _ONE, _ZERO
            ends = i >= n - 2
            reach = r + _HALF
            y1 = y0 + ay * length
            low = max(int(np.ceil(min(y0, y1) - reach)), 0)
            high = min(int(np.floor(max(y0, y1) + reach)), height - 1)
            x1 = x0 + ax * length
            if high < low:
                before += length
                continue
            if bottom < 0:
                top, bottom = low, high
                for y in range(low, high + 1):
                    rows[y, 0] = width
                    rows[y, 1] = -1
            for y in range(low, top):
                rows[y, 0] = width
                rows[y, 1] = -1
            for y in range(bottom + 1, high + 1):
                rows[y, 0] = width
                rows[y, 1] = -1
            top, bottom = min(top, low), max(bottom, high)
            for y in range(low, high + 1):
                left, right = min(x0, x1) - reach, max(x0, x1) + reach
                fy = np.float32(y) - y0
                if abs(ay) > np.float32(0.05):
                    # Where this row crosses the segment's strip, of infinite length.
                    middle, half = x0 + ax * fy / ay, reach / abs(ay)
                    left, right = max(left, middle - half), min(right, middle + half)
                first, final = max(int(np.ceil(left)), 0), min(int(np.floor(right)), width - 1)
                for x in range(first, final + 1):
                    fx = np.float32(x) - x0
                    s, t = fx * ax + fy * ay, fy * ax - fx * ay
                    if s > length:
                        if not ends:
                            continue  # the next segment's round joint covers it
                        d = np.sqrt((s - length) * (s - length) + t * t)
                        p = length
                    elif s < _ZERO:
                        d = np.sqrt(s * s + t * t)
                        p = _ZERO
                    else:
                        d = abs(t)
                        p = s
                    w = r
                    if total > _ZERO:
                        u = (before + p) / total
                        if u < _TIP:
                            q = _ONE - u / _TIP
                            w = r * (_ONE - profile[k, TAPER_START] * q * q)
                        elif u > _ONE - _TIP:
                            q = _ONE - (_ONE - u) / _TIP
                            w = r * (_ONE - profile[k, TAPER_END] * q * q)
                    c = min(w + _HALF - d, _ONE)
                    if c > cover[y, x]:
                        cover[y, x] = c
                        along[y, x] = before + s
                        across[y, x] = min(max(t / r, -_ONE), _ONE)
                        rows[y, 0] = min(rows[y, 0], x)
                        rows[y, 1] = max(rows[y, 1], x)
            before += length
        oa, ob = bristles.offsets[k] & 63, bristles.offsets[k] >> 6
        dense = r * (profile[k, BRISTLES] / _BRISTLES)
        red, green, blue = strokes.colours[k, 0], strokes.colours[k, 1], strokes.colours[k, 2]
        target_r, target_g, target_b = strokes.targets[k, 0], strokes.targets[k, 1], strokes.targets[k, 2]
        g, thick, strength = strokes.grain[k], strokes.relief_px[k], strokes.opacity[k]
        tolerance = guide.tolerances[k]
        for y in range(top, bottom + 1):
            for x in range(rows[y, 0], rows[y, 1] + 1):
                a = cover[y, x]
                if a <= _ZERO:
                    continue
                cover[y, x] = _ZERO
                a *= strength
                if guide.enabled:
                    er = np.float32(guide.image[y, x, 0]) - target_r
                    eg = np.float32(guide.image[y, x, 1]) - target_g
                    eb = np.float32(guide.image[y, x, 2]) - target_b
                    e2 = er * er + eg * eg + eb * eb
                    soft = max(tolerance * np.float32(0.25), guide.slopes[y, x])
                    fit = _HALF + (tolerance * np.float32(1.125) - np.sqrt(e2)) / soft
                    if fit <= _ZERO:
                        continue
                    a *= min(fit, _ONE)
                t = across[y, x]
                shade, ridge = _ZERO, _ONE - t * t * t * t
                if g > _ZERO:
                    trace = hair(bristles.tile, along[y, x], t, dense, oa, ob)
                    shade = g * profile[k, STREAKS] * (trace - _HALF)
                    ridge *= _ONE - g * (_ONE - trace)
                    if total > _ZERO:
                        late = (along[y, x] / total - _HALF) * np.float32(2.0)
                        if late > _ZERO:
                            a *= _ONE - g * profile[k, DRY] * late * (_ONE if trace < _HALF * late else _ZERO)
                if traced:
                    seen.cover[y, x] += a * (_ONE - seen.cover[y, x])
                    if a >= _HALF:
                        seen.owners[y, x] = numbers[k]
                canvas[y, x, 0] += a * (red + shade - canvas[y, x, 0])
                canvas[y, x, 1] += a * (green + shade - canvas[y, x, 1])
                canvas[y, x, 2] += a * (blue + shade - canvas[y, x, 2])
                canvas[y, x, HEIGHT] += a * (thick * ridge - canvas[y, x, HEIGHT])
                canvas[y, x, TARGET] += a * (target_r - canvas[y, x, TARGET])
                canvas[y, x, TARGET + 1] += a * (target_g - canvas[y, x, TARGET + 1])
                canvas[y, x, TARGET + 2] += a * (target_b - canvas[y, x, TARGET + 2])
