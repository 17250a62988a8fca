"""Implicit strokes, fast: each disc is dragged along the streamline through its centre, the uppermost first.

`sweep` finds the stroke that covers a pixel by walking the streamline through that pixel, as eq. 5 of kagaya2011video
says; most walks meet the same strokes again and again. Here each stroke's own streamline is followed, once, and what it
covers is what the disc covers on its way. Where streamlines run side by side both are the same; where they part, a
stroke of `sweep` widens and this one keeps its width.

The total order makes it cheap: with the uppermost stroke first, a pixel that is covered is done. No stroke below is
painted there, of this layer or of a coarser one. So the finest layer is painted first, and the ground last.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.segmentation.jit import kernel
from pipeline.strokes.bristles import Tile, fine_tile, soft_hair
from pipeline.strokes.brush import Direction, Strokes
from pipeline.strokes.random import Purpose, draws
from pipeline.strokes.raster import Touch
from pipeline.strokes.trace import draw_out

Wet: TypeAlias = NDArray[np.float32]
"""A painting from the top down, `float32` (height, width, 5): red, green, blue and height of the paint so far, each
times its share of the pixel; and the share of the pixel that is still bare, 1 at the start."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_HAIRS, _FINEST, _PULL = np.float32(5.0), np.float32(0.9), np.float32(1.7)
"""Traces from a stroke's middle to its side, at most; and per px, at most: finer ones are noise on a grid of pixels,
and tremble when they move. How much longer than wide they are drawn."""
_TIP, _PER_TIP = np.float32(0.3), np.float32(1 / 0.3)
_STRAIGHT = np.float32(0.1)
"""Pixels by which a stroke's path may be straightened: a long segment costs as much as a short one."""
_DONE = np.float32(0.03)
_NO_GUIDE: Frame = np.zeros((1, 1, 3), np.uint8)


def bare(shape: tuple[int, ...]) -> Wet:
    """Nothing painted yet."""
    out = np.zeros((*shape[:2], 5), np.float32)
    out[..., 4] = 1
    return out


def drag(
    wet: Wet, starts: Strokes, field: Direction, length_px: NDArray[np.float32], order: NDArray[np.intp], *,
    seed: int = 0, touch: Touch | None = None, guide: Frame | None = None,
    tolerance: float | NDArray[np.float32] = 80.0, threads: int = 1,
) -> None:  # fmt: skip
    """Paint a layer under what is there, in place.

    Args:
        starts: one point a stroke (see `discs`).
        field: float32 (h, w, 2): (cos 2a, sin 2a) of the orientation.
        length_px: float32 (n,), from tip to tip.
        order: indices of the strokes, the uppermost first.
        guide, tolerance: as in `paint`: strokes keep off pixels of another colour; the tolerance may be each one's own,
            float32 (n,).
        threads: bands of rows that are worked on at once; the result is the same.

    Source: kagaya2011video, section 4.2. Departure: see the top of this file.
    """
    if len(starts) == 0:
        return
    touch, guided = touch or Touch(), guide is not None
    lines = draw_out(starts, length_px, field)
    offset = (draws(starts.ids, seed, Purpose.BRISTLES)[:, 0] * np.float32(1 << 16)).astype(np.int32)
    height, hairs = wet.shape[0], fine_tile(seed)
    own = np.ascontiguousarray(np.broadcast_to(np.asarray(tolerance, np.float32), len(starts)))

    def band(top: int, bottom: int) -> None:
        _drag(
            wet, lines.points, lines.counts, lines.radius_px, lines.colours, lines.aims, lines.opacity,
            lines.relief_px, lines.grain, order, offset, hairs, _NO_GUIDE if guide is None else guide, guided,
            own, np.float32(touch.taper[0]), np.float32(touch.taper[1]), np.float32(touch.streaks),
            np.float32(touch.dry), np.float32(touch.soft), top, bottom,
        )  # fmt: skip

    edges = [height * i // threads for i in range(threads + 1)]
    if threads == 1:
        band(0, height)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(band, edges[:-1], edges[1:]))


def lay_on(wet: Wet, ground: NDArray[np.float32]) -> NDArray[np.float32]:
    """The painting on its ground, float32 (h, w, 4): red, green, blue, height of the paint; ready for `emboss`.

    Args:
        ground: float32 (h, w, 3), RGB 0..255.
    """
    out = np.empty((*wet.shape[:2], 4), np.float32)
    _lay_on(wet, ground, out)
    return out


@kernel
def _lay_on(wet: Wet, ground: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    height, width = wet.shape[:2]
    for y in range(height):
        for x in range(width):
            left = wet[y, x, 4]
            for c in range(3):
                out[y, x, c] = wet[y, x, c] + left * ground[y, x, c]
            out[y, x, 3] = wet[y, x, 3]


@kernel
def _thin(points: NDArray[np.float32], n: int, line: NDArray[np.float32]) -> int:
    """Copy to `line`, float32 (n, 2), the points that are needed: those between lie within `_STRAIGHT` of the chords.
    How many they are.
    """
    line[0, 0], line[0, 1] = points[0, 0], points[0, 1]
    kept, anchor, end = 1, 0, 2
    while end <= n:
        straight = end < n and end - anchor < 8
        if straight:
            ax, ay = points[end, 0] - points[anchor, 0], points[end, 1] - points[anchor, 1]
            length2 = ax * ax + ay * ay
            for i in range(anchor + 1, end):
                bx, by = points[i, 0] - points[anchor, 0], points[i, 1] - points[anchor, 1]
                off = bx * ay - by * ax
                if off * off > _STRAIGHT * _STRAIGHT * length2 or bx * ax + by * ay < _ZERO:
                    straight = False
        if not straight:
            anchor = end - 1
            line[kept, 0], line[kept, 1] = points[anchor, 0], points[anchor, 1]
            kept += 1
        end += 1
    return kept


@kernel
def _drag(
    wet: Wet, points: NDArray[np.float32], counts: NDArray[np.int32], radius: NDArray[np.float32],
    colours: NDArray[np.float32], aims: NDArray[np.float32], opacity: NDArray[np.float32],
    relief: NDArray[np.float32], grain: NDArray[np.float32], order: NDArray[np.intp], offset: NDArray[np.int32],
    hairs: Tile, guide: Frame, guided: bool, tolerances: NDArray[np.float32], taper_start: np.float32,
    taper_end: np.float32, streaks: np.float32, dry: np.float32, soft: np.float32, band_top: int, band_bottom: int,
) -> None:  # fmt: skip
    width = wet.shape[1]
    rows_high = band_bottom - band_top
    # How far the stroke covers a pixel of its box, and where that is along and across it: a small part of this.
    scratch = np.zeros((rows_high * width, 3), np.float32)
    rows = np.empty((rows_high, 2), np.int32)
    line = np.empty((points.shape[1], 2), np.float32)
    for k in order:
        r, tolerance = radius[k], tolerances[k]
        n = _thin(points[k], counts[k], line)
        inner2 = tolerance * tolerance
        outer2 = inner2 * np.float32(1.5625)
        low_x, high_x, low_y, high_y = line[0, 0], line[0, 0], line[0, 1], line[0, 1]
        total = _ZERO
        for i in range(n - 1):
            ax, ay = line[i + 1, 0] - line[i, 0], line[i + 1, 1] - line[i, 1]
            total += np.sqrt(ax * ax + ay * ay)
            low_x, high_x = min(low_x, line[i + 1, 0]), max(high_x, line[i + 1, 0])
            low_y, high_y = min(low_y, line[i + 1, 1]), max(high_y, line[i + 1, 1])
        blur = _ONE + soft * r
        sharp, reach = _ONE / blur, r + _HALF * blur
        first_row = max(int(np.ceil(low_y - reach)), band_top)
        last_row = min(int(np.floor(high_y + reach)), band_bottom - 1)
        first_column = max(int(np.ceil(low_x - reach)), 0)
        last_column = min(int(np.floor(high_x + reach)), width - 1)
        columns = last_column - first_column + 1
        if last_row < first_row or columns <= 0:
            continue
        for y in range(last_row + 1 - first_row):
            rows[y, 0] = width
            rows[y, 1] = -1
        part = _ONE / total if total > _ZERO else _ZERO
        per_r = _ONE / r
        before, past_x, past_y = _ZERO, _ZERO, _ZERO
        for i in range(max(n - 1, 1)):
            x0, y0 = line[i, 0], line[i, 1]
            last = min(i + 1, n - 1)
            ax, ay = line[last, 0] - x0, line[last, 1] - y0
            length = np.sqrt(ax * ax + ay * ay)
            if length > np.float32(1e-4):
                ax, ay = ax / length, ay / length
            else:
                ax, ay = _ONE, _ZERO
            ends = i >= n - 2
            # Behind its start a segment covers what the bend leaves open, and in front of its end nothing.
            first_s = -reach if i == 0 else -(reach * abs(past_x * ay - past_y * ax) + _HALF)
            if past_x * ax + past_y * ay < _ZERO:
                first_s = -reach
            last_s = length + reach if ends else length
            past_x, past_y = ax, ay
            x1, y1 = x0 + ax * length, y0 + ay * length
            low = max(int(np.ceil(min(y0, y1) - reach)), band_top)
            high = min(int(np.floor(max(y0, y1) + reach)), band_bottom - 1)
            left_most, right_most = min(x0, x1) - reach, max(x0, x1) + reach
            # Where a row crosses the segment's strip, of infinite length; and where it enters and leaves its length.
            steep, flat = abs(ay) > np.float32(0.05), abs(ax) > np.float32(0.05)
            slope, half, enter, leave, lean = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
            if steep:
                slope, half = ax / ay, reach / abs(ay)
            if flat:
                lean = ay / ax
                enter, leave = x0 + first_s / ax, x0 + last_s / ax
                enter, leave = min(enter, leave), max(enter, leave)
            whole = total <= _ZERO or (before >= _TIP * total and before + length <= (_ONE - _TIP) * total)
            for y in range(low, high + 1):
                left, right = left_most, right_most
                fy = np.float32(y) - y0
                if steep:
                    middle = x0 + slope * fy
                    left, right = max(left, middle - half), min(right, middle + half)
                if flat:
                    left, right = max(left, enter - lean * fy), min(right, leave - lean * fy)
                start, final = max(int(np.ceil(left)), first_column), min(int(np.floor(right)), last_column)
                row = y - first_row
                box = row * columns - first_column
                s_row, t_row = fy * ay, fy * ax
                for x in range(start, final + 1):
                    if wet[y, x, 4] <= _DONE:
                        continue
                    fx = np.float32(x) - x0
                    s, t = fx * ax + s_row, t_row - fx * ay
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
                    if not whole:
                        u = (before + p) * part
                        if u < _TIP:
                            q = _ONE - u * _PER_TIP
                            w = r * (_ONE - taper_start * q * q)
                        elif u > _ONE - _TIP:
                            q = _ONE - (_ONE - u) * _PER_TIP
                            w = r * (_ONE - taper_end * q * q)
                    c = min((w - d) * sharp + _HALF, _ONE)
                    if c > scratch[box + x, 0]:
                        scratch[box + x, 0] = c
                        scratch[box + x, 1] = before + s
                        scratch[box + x, 2] = min(max(t * per_r, -_ONE), _ONE)
                        rows[row, 0] = min(rows[row, 0], x)
                        rows[row, 1] = max(rows[row, 1], x)
            before += length
        oa, ob = offset[k] & 63, offset[k] >> 6
        red, green, blue = colours[k, 0], colours[k, 1], colours[k, 2]
        aim_r, aim_g, aim_b = aims[k, 0], aims[k, 1], aims[k, 2]
        g, thick, strength = grain[k], relief[k], opacity[k]
        spread = min(r * _FINEST, _HAIRS)
        pull = _PULL * spread / r
        for y in range(first_row, last_row + 1):
            row = y - first_row
            box = row * columns - first_column
            for x in range(rows[row, 0], rows[row, 1] + 1):
                a = scratch[box + x, 0]
                if a <= _ZERO:
                    continue
                scratch[box + x, 0] = _ZERO
                a *= strength
                if guided:
                    er = np.float32(guide[y, x, 0]) - aim_r
                    eg = np.float32(guide[y, x, 1]) - aim_g
                    eb = np.float32(guide[y, x, 2]) - aim_b
                    e2 = er * er + eg * eg + eb * eb
                    if e2 >= outer2:
                        continue
                    if e2 > inner2:
                        a *= (tolerance * np.float32(1.25) - np.sqrt(e2)) / (tolerance * np.float32(0.25))
                along, t = scratch[box + x, 1], scratch[box + x, 2]
                shade, ridge = _ZERO, _ONE - t * t * t * t
                if g > _ZERO:
                    trace = soft_hair(hairs, along * pull, t * spread, oa, ob)
                    shade = g * streaks * (trace - _HALF)
                    ridge *= _ONE - g * (_ONE - trace)
                    late = (along * part - _HALF) * np.float32(2.0)
                    if late > _ZERO:
                        a *= _ONE - g * dry * late * (_ONE if trace < _HALF * late else _ZERO)
                a *= wet[y, x, 4]
                wet[y, x, 0] += a * (red + shade)
                wet[y, x, 1] += a * (green + shade)
                wet[y, x, 2] += a * (blue + shade)
                wet[y, x, 3] += a * thick * ridge
                wet[y, x, 4] -= a
