"""Implicit strokes by forward streamlines: each disc is moved along the streamline through its centre, front to back.

kagaya2011video (eq. 5) asks at each pixel for the topmost disc on the streamline through it; most of these walks meet
the same strokes repeatedly. Here the streamline of each stroke is followed once, and the stroke covers the pixels that
the disc covers on its way. Both agree where streamlines are parallel; where they diverge, a stroke of the paper becomes
wider, and a stroke of ours keeps its width.

The total order of the strokes makes this cheap: the topmost stroke is painted first, and an opaque pixel is finished.
No stroke below it is painted there, whether of the same or of a coarser layer. So the finest layer is painted first and
the ground last.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.kernels.jit import kernel
from pipeline.strokes.bristles import BristleArgs, bristle_args, fine_tile, soft_hair
from pipeline.strokes.brush import HEIGHT, Direction, GuideArgs, StrokeArrays, Strokes, guide_args
from pipeline.strokes.raster import (
    BRISTLES,
    DRY,
    SOFT,
    STREAKS,
    TAPER_END,
    TAPER_START,
    Profiles,
    StrokeProfile,
    profiles,
    stroke_numbers,
)
from pipeline.strokes.trace import trace_along, unit_tangents

TRANSMITTANCE = 4
"""Channel of `FrontToBack.paint`; the paint height is channel `HEIGHT`."""


class FrontToBack(NamedTuple):
    """Front-to-back compositing buffer.

    Attributes:
        paint: float32 (height, width, 5): premultiplied red, green, blue and paint height, and the transmittance, which
            is 1 where nothing is painted.
        finished: bool (height, width), pixels whose transmittance is at most `_OPAQUE`; nothing more is painted there.
            The paint itself does not fit in the processor's nearer cache.
    """

    paint: NDArray[np.float32]
    finished: NDArray[np.bool_]


_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_FINEST, _PULL = np.float32(0.9), np.float32(1.7)
"""Most bristles a px, since finer ones alias and flicker under motion; ratio of a bristle's length to its width,
relative to `bristles.tile`."""
_TIP, _PER_TIP = np.float32(0.3), np.float32(1 / 0.3)
"""Share of a stroke's length in which it tapers, at either end."""
_STRAIGHT = np.float32(0.1)
"""Deviation, px, that the simplification of a stroke's polyline allows; long segments cost as much as short ones."""
_1, _2, _3, _4 = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(4)
_OPAQUE = np.float32(0.03)
"""Transmittance below which a pixel counts as finished."""
_SCRATCH = 1 << 12
"""Pixels of a stroke's bounding box for which memory is reserved at first; a larger box gets twice what it needs."""


@dataclass(frozen=True)
class RasterOptions:
    """Options of the rasteriser.

    Attributes:
        seed: random seed of the bristle texture.
        profile: one for all strokes, or one each.
        guide, tolerance: as in `raster.paint`.
        threads: number of horizontal bands that are painted concurrently; it does not change the result.
        tangents: `trace.unit_tangents` of the field; None = computed here.
        owners: uint32 (h, w): pixels at which a stroke makes more than half of what is seen opaque get its
            `stroke_numbers`; None = not wanted.
    """

    seed: int = 0
    profile: StrokeProfile | Profiles | None = None
    guide: Frame | None = None
    tolerance: float | NDArray[np.float32] = 80.0
    threads: int = 1
    tangents: NDArray[np.float32] | None = None
    owners: NDArray[np.uint32] | None = None


def empty_buffer(shape: tuple[int, ...]) -> FrontToBack:
    """Make a buffer without paint, for frames of this shape: (h, w) or (h, w, channels)."""
    out = FrontToBack(np.empty((*shape[:2], 5), np.float32), np.empty(shape[:2], np.bool_))
    clear(out)
    return out


@kernel
def clear(buffer: FrontToBack) -> None:
    """Remove all paint, in place."""
    height, width = buffer.paint.shape[:2]
    for y in range(height):
        for x in range(width):
            for c in range(TRANSMITTANCE):
                buffer.paint[y, x, c] = _ZERO
            buffer.paint[y, x, TRANSMITTANCE] = _ONE
            buffer.finished[y, x] = False


def streamlines_forward(
    buffer: FrontToBack, starts: Strokes, field: Direction, length_px: NDArray[np.float32], order: NDArray[np.intp],
    options: RasterOptions | None = None,
) -> None:  # fmt: skip
    """Paint a layer of strokes behind the contents of the buffer, in place.

    Args:
        starts: strokes of one point each (see `discs`).
        field: float32 (h, w, 2): (cos 2a, sin 2a) of the orientation.
        length_px: float32 (n,), from tip to tip.
        order: indices of the strokes, topmost first.

    Source: kagaya2011video, section 4.2. Departure: see the module's docstring.
    """
    if len(starts) == 0:
        return
    options = options or RasterOptions()
    tangents = unit_tangents(field) if options.tangents is None else options.tangents
    strokes = trace_along(starts, length_px, field, tangents)
    bristles = bristle_args(fine_tile(options.seed), starts.ids, options.seed)
    guide = guide_args(len(starts), options.guide, options.tolerance)
    profile = profiles(options.profile, len(starts))
    traced = None if options.owners is None else (options.owners.reshape(-1), stroke_numbers(starts.ids))

    def paint_band(top: int, bottom: int) -> None:
        _paint_strokes(buffer, strokes.arrays, order, bristles, guide, profile, (top, bottom), traced)

    in_bands(paint_band, buffer.paint.shape[0], options.threads)


def in_bands(paint_band: Callable[[int, int], None], height: int, threads: int) -> None:
    """Call `paint_band(top, bottom)` for bands of rows that cover the picture, one thread a band."""
    edges = [height * i // threads for i in range(threads + 1)]
    if threads == 1:
        paint_band(0, height)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(paint_band, edges[:-1], edges[1:]))


def composite_over(
    buffer: FrontToBack, ground: NDArray[np.float32], out: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """Composite the buffer over the ground: float32 (h, w, 4), red, green, blue and paint height; input of `emboss`.

    Args:
        ground: float32 (h, w, 3), RGB 0..255.
        out: array for the result; None = a new one.
    """
    out = np.empty((*buffer.paint.shape[:2], 4), np.float32) if out is None else out
    _composite(buffer.paint, ground, out)
    return out


@kernel
def _composite(paint: NDArray[np.float32], ground: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    height, width = paint.shape[:2]
    for y in range(height):
        for x in range(width):
            left = paint[y, x, TRANSMITTANCE]
            for c in range(3):
                out[y, x, c] = paint[y, x, c] + left * ground[y, x, c]
            out[y, x, HEIGHT] = paint[y, x, HEIGHT]


@kernel
def _simplify(points: NDArray[np.float32], n: int, line: NDArray[np.float32]) -> int:
    """Simplify a polyline: copy to `line`, float32 (n, 2), points whose chords are within `_STRAIGHT` of the others.

    Return the number of points kept.
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
def _paint_strokes(
    buffer: FrontToBack, strokes: StrokeArrays, order: NDArray[np.intp], bristles: BristleArgs, guide: GuideArgs,
    profile: Profiles, band: tuple[int, int], traced: tuple[NDArray[np.uint32], NDArray[np.uint32]] | None,
) -> None:  # fmt: skip
    """Paint strokes into the rows [band[0], band[1]). `traced`: `RasterOptions.owners`, flat, and the numbers of the
    strokes; the kernel is compiled without them if they are None."""
    width = buffer.paint.shape[1]
    band_top, band_bottom = band
    finished = buffer.finished.reshape(-1)
    points = strokes.points
    # Flat arrays with unsigned indices: signed ones are tested for being negative at every access.
    pixels, image = buffer.paint.reshape(-1), guide.image.reshape(-1)
    # Per pixel of a stroke's bounding box: coverage, and position along and across the stroke.
    coverage, lengthwise = np.zeros(_SCRATCH, np.float32), np.empty(_SCRATCH, np.float32)
    crosswise = np.empty(_SCRATCH, np.float32)
    rows = np.empty((band_bottom - band_top, 2), np.int32)
    line = np.empty((points.shape[1], 2), np.float32)
    for k in order:
        r, tolerance = strokes.radius_px[k], guide.tolerances[k]
        taper_start, taper_end = profile[k, TAPER_START], profile[k, TAPER_END]
        dry, soft = profile[k, DRY], profile[k, SOFT]
        n = _simplify(points[k], strokes.counts[k], line)
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
        if (last_row + 1 - first_row) * columns > len(coverage):
            size = 2 * (last_row + 1 - first_row) * columns
            coverage, lengthwise = np.zeros(size, np.float32), np.empty(size, np.float32)
            crosswise = np.empty(size, np.float32)
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
            # A segment extends behind its start to fill the gap of the bend, and not beyond its end.
            first_s = -reach if i == 0 else -(reach * abs(past_x * ay - past_y * ax) + _HALF)
            if past_x * ax + past_y * ay < _ZERO:
                first_s = -reach
            last_s = length + reach if ends else length
            past_x, past_y = ax, ay
            x1, y1 = x0 + ax * length, y0 + ay * length
            low = max(int(np.ceil(min(y0, y1) - reach)), band_top)
            high = min(int(np.floor(max(y0, y1) + reach)), band_bottom - 1)
            left_most, right_most = min(x0, x1) - reach, max(x0, x1) + reach
            # Columns where a row crosses the infinite strip of the segment, and where it enters and leaves the length.
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
                box, in_row = row * columns - first_column, y * width
                while start <= final and finished[np.uintp(in_row + start)]:
                    start += 1
                while start <= final and finished[np.uintp(in_row + final)]:
                    final -= 1
                s_row, t_row = fy * ay, fy * ax
                first_covered, last_covered = rows[row, 0], rows[row, 1]
                for x in range(start, final + 1):
                    if finished[np.uintp(in_row + x)]:
                        continue
                    fx = np.float32(x) - x0
                    s, t = fx * ax + s_row, t_row - fx * ay
                    if s > length and not ends:
                        continue  # the next segment's round joint covers it
                    # Without branches, which the processor could not foresee.
                    p = min(max(s, _ZERO), length)
                    beyond = s - p
                    d = np.sqrt(beyond * beyond + t * t)
                    w = r
                    if not whole:
                        u = (before + p) * part
                        q = max(_ONE - u * _PER_TIP, _ZERO)
                        v = max(_ONE - (_ONE - u) * _PER_TIP, _ZERO)
                        w = r * (_ONE - (taper_start * q * q + taper_end * v * v))
                    c = min((w - d) * sharp + _HALF, _ONE)
                    at = np.uintp(box + x)
                    if c > coverage[at]:
                        coverage[at] = c
                        lengthwise[at] = before + s
                        crosswise[at] = min(max(t * per_r, -_ONE), _ONE)
                        first_covered = min(first_covered, x)
                        last_covered = max(last_covered, x)
                rows[row, 0], rows[row, 1] = first_covered, last_covered
            before += length
        oa, ob = bristles.offsets[k] & 63, bristles.offsets[k] >> 6
        red, green, blue = strokes.colours[k, 0], strokes.colours[k, 1], strokes.colours[k, 2]
        target_r, target_g, target_b = strokes.targets[k, 0], strokes.targets[k, 1], strokes.targets[k, 2]
        g, thick, strength = strokes.grain[k], strokes.relief_px[k], strokes.opacity[k]
        spread = min(r * _FINEST, profile[k, BRISTLES])
        pull = _PULL * spread / r
        streaks = profile[k, STREAKS]
        for y in range(first_row, last_row + 1):
            row = y - first_row
            box, pixel = row * columns - first_column, y * width
            for x in range(rows[row, 0], rows[row, 1] + 1):
                at = np.uintp(box + x)
                a = coverage[at]
                if a <= _ZERO:
                    continue
                coverage[at] = _ZERO
                a *= strength
                if guide.enabled:
                    colour = np.uintp((pixel + x) * 3)
                    er = np.float32(image[colour]) - target_r
                    eg = np.float32(image[colour + _1]) - target_g
                    eb = np.float32(image[colour + _2]) - target_b
                    e2 = er * er + eg * eg + eb * eb
                    if e2 >= outer2:
                        continue
                    if e2 > inner2:
                        a *= (tolerance * np.float32(1.25) - np.sqrt(e2)) / (tolerance * np.float32(0.25))
                along, t = lengthwise[at], crosswise[at]
                shade, ridge = _ZERO, _ONE - t * t * t * t
                if g > _ZERO:
                    trace = soft_hair(bristles.tile, along * pull, t * spread, oa, ob)
                    shade = g * streaks * (trace - _HALF)
                    ridge *= _ONE - g * (_ONE - trace)
                    late = (along * part - _HALF) * np.float32(2.0)
                    if late > _ZERO:
                        a *= _ONE - g * dry * late * (_ONE if trace < _HALF * late else _ZERO)
                paint = np.uintp((pixel + x) * 5)
                behind = pixels[paint + _4]
                a *= behind
                pixels[paint] += a * (red + shade)
                pixels[paint + _1] += a * (green + shade)
                pixels[paint + _2] += a * (blue + shade)
                pixels[paint + _3] += a * thick * ridge
                pixels[paint + _4] -= a
                finished[np.uintp(pixel + x)] = pixels[paint + _4] <= _OPAQUE
                if traced is not None:  # an `if` of its own, which Numba leaves out
                    crosses = behind > _HALF and pixels[paint + _4] <= _HALF
                    if crosses:
                        traced[0][np.uintp(pixel + x)] = traced[1][k]
