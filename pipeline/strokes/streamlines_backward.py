"""Implicit strokes by backward streamlines: each pixel finds the topmost disc on the streamline through it.

kagaya2011video draws the seeds as discs C_0 and iterates C_(i+1) = f(C_i advected along the field, C_0), where f takes
the smaller colour of a total order (eq. 5). The minimum is associative and f keeps what is not covered, so C_n(p) is
the smallest colour of C_0 on the streamline through p. This module computes that result directly: each pixel walks its
streamline once, in both directions, and nothing is resampled repeatedly. Ranks in the order of colours are compared
instead of colours, so that the stroke and the position in it are known, and bristle texture and relief can be applied.
The paper's strokes are stamps one step apart; these have straight, anti-aliased sides.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.jit import kernel
from pipeline.strokes.bristles import BristleArgs, bristle_args, hair, tile
from pipeline.strokes.brush import HEIGHT, TARGET, Canvas, Direction, GuideArgs, StrokeArrays, Strokes, guide_args
from pipeline.strokes.raster import STREAKS, profiles
from pipeline.strokes.seeds import StyleField, as_plane
from pipeline.strokes.streamlines_forward import RasterOptions, in_bands
from pipeline.strokes.trace import tangent

Ranks = NDArray[np.int32]
"""Topmost stroke at each pixel, `int32` (height, width): its rank in the order of colours, or `UNCOVERED`."""

UNCOVERED = np.iinfo(np.int32).max
"""Rank of pixels without a stroke; greater than any rank."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)

_LONGEST = np.float32(1.15)
"""Largest ratio of a second-order step to its nominal length, reached where directions turn by 37 degrees a step."""


class _Walk(NamedTuple):
    """Input of a walk along a streamline.

    Attributes:
        discs: the stamped discs, C_0.
        tangents: float32 (h, w, 2), unit vectors.
        lengths: float32 (h, w), stroke lengths, px.
        gap: float32 (h, w), lower bound of the distance to the nearest disc, px.
        step: px.
    """

    discs: Ranks
    tangents: NDArray[np.float32]
    lengths: Plane
    gap: Plane
    step: np.float32


def colour_order(colours: NDArray[np.float32]) -> NDArray[np.intp]:
    """Sort RGB colours (n, 3) by R^2 + G^2 + B^2, then G, then R, then B; return indices, smallest first.

    Source: kagaya2011video, eq. 5. The sort is stable.
    """
    whole = np.rint(colours).astype(np.int64)
    return np.lexsort((whole[:, 2], whole[:, 0], whole[:, 1], (whole * whole).sum(axis=1)))


def streamlines_backward(
    canvas: Canvas, starts: Strokes, field: Direction, length_px: StyleField, order: NDArray[np.intp] | None = None,
    options: RasterOptions | None = None,
) -> Ranks:  # fmt: skip
    """Paint strokes along the field on the canvas, in place.

    Args:
        starts: strokes of one point each (see `discs`).
        field: float32 (h, w, 2): (cos 2a, sin 2a) of the orientation.
        length_px: from tip to tip; one for the picture, or float32 (h, w).
        order: indices of the strokes, topmost first; None = `colour_order` of the paint colours, as the paper has it.

    Returns:
        Index in `starts` of each pixel's stroke, or `UNCOVERED`, before opacity.
    """
    options, shape = options or RasterOptions(), canvas.shape[:2]
    out = np.full(shape, UNCOVERED, np.int32)
    if len(starts) == 0:
        return out
    order = np.ascontiguousarray(colour_order(starts.colours) if order is None else order)
    guide = guide_args(len(starts), options.guide, options.tolerance)
    lengths = np.ascontiguousarray(as_plane(length_px, shape))
    step = np.float32(max(float(np.median(starts.radius_px)) * 1.1, 1.0))
    discs = _stamp(starts, order, step, lengths, guide)
    tangents = np.empty((*shape, 2), np.float32)
    _tangents(field, tangents)
    walk = _Walk(discs, tangents, lengths, _gap(discs), step)
    bristles = bristle_args(tile(options.seed), starts.ids, options.seed)
    streaks = np.ascontiguousarray(profiles(options.profile, len(starts))[:, STREAKS])

    def paint_band(top: int, bottom: int) -> None:
        _walk_rows(walk, starts.arrays, order, bristles, guide, streaks, (canvas, out), (top, bottom))

    in_bands(paint_band, shape[0], options.threads)
    return out


def _stamp(starts: Strokes, order: NDArray[np.intp], step: np.float32, lengths: Plane, guide: GuideArgs) -> Ranks:
    """Draw the discs C_0, larger than the strokes, so that two discs one step apart fill a strip of the stroke's width.

    The walk trims the strip to the exact width.
    """
    ranks = np.full(lengths.shape, UNCOVERED, np.int32)
    overlap = step * _HALF if lengths.max() * _HALF >= step else _ZERO
    radius = np.sqrt((starts.radius_px + _HALF) ** 2 + overlap * overlap).astype(np.float32)
    _draw_discs(starts.arrays, radius, order, guide, ranks)
    return ranks


def _gap(ranks: Ranks) -> Plane:
    """Lower bound of each pixel's distance to the nearest disc, px: walks that cannot reach a disc are skipped.

    OpenCV's 5 x 5 distance transform has an error of 2 %; 5 % are subtracted.
    """
    away = cv2.distanceTransform((ranks == UNCOVERED).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(away * np.float32(0.95), np.float32)


@kernel
def _distance2(image: Frame, y: int, x: int, targets: NDArray[np.float32], k: int) -> np.float32:
    """Squared RGB distance between a pixel and the target colour of stroke `k`."""
    red = np.float32(image[y, x, 0]) - targets[k, 0]
    green = np.float32(image[y, x, 1]) - targets[k, 1]
    blue = np.float32(image[y, x, 2]) - targets[k, 2]
    total: np.float32 = red * red + green * green + blue * blue
    return total


@kernel
def _draw_discs(
    strokes: StrokeArrays, radius: NDArray[np.float32], order: NDArray[np.intp], guide: GuideArgs, ranks: Ranks
) -> None:
    height, width = ranks.shape
    for rank in range(len(order)):
        k = order[rank]
        x0, y0, r = strokes.points[k, 0, 0], strokes.points[k, 0, 1], radius[k]
        limit = guide.tolerances[k] * guide.tolerances[k]
        for y in range(max(int(np.ceil(y0 - r)), 0), min(int(np.floor(y0 + r)), height - 1) + 1):
            dy = np.float32(y) - y0
            half = np.sqrt(max(r * r - dy * dy, _ZERO))
            for x in range(max(int(np.ceil(x0 - half)), 0), min(int(np.floor(x0 + half)), width - 1) + 1):
                if ranks[y, x] <= rank:
                    continue
                if guide.enabled and _distance2(guide.image, y, x, strokes.targets, k) > limit:
                    continue
                ranks[y, x] = rank


@kernel
def _tangents(field: Direction, out: NDArray[np.float32]) -> None:
    height, width = field.shape[:2]
    for y in range(height):
        for x in range(width):
            tx, ty = tangent(field[y, x, 0], field[y, x, 1], _ZERO, _ZERO)
            out[y, x, 0], out[y, x, 1] = tx, ty


@kernel
def _walk_rows(
    walk: _Walk, strokes: StrokeArrays, order: NDArray[np.intp], bristles: BristleArgs, guide: GuideArgs,
    streaks: NDArray[np.float32], painted: tuple[Canvas, Ranks], band: tuple[int, int],
) -> None:  # fmt: skip
    """Paint the rows [band[0], band[1]) of `painted`, a canvas and the index of each pixel's stroke."""
    canvas, out = painted
    ranks, tangents, lengths, gap, step = walk
    height, width = ranks.shape
    for y in range(band[0], band[1]):
        for x in range(width):
            if gap[y, x] > lengths[y, x] * _HALF * _LONGEST + _ONE:
                continue
            best, second = UNCOVERED, UNCOVERED
            t, s, nearby = _ZERO, _ZERO, _ZERO
            second_t, second_s = _ZERO, _ZERO
            steps = int(lengths[y, x] * _HALF / step)
            start_x, start_y = tangents[y, x, 0], tangents[y, x, 1]
            still = start_x == _ZERO and start_y == _ZERO
            for side in range(2):
                sign = np.float32(1 - 2 * side)
                px, py, dx, dy = np.float32(x), np.float32(y), start_x * sign, start_y * sign
                step_x, step_y = step * dx, step * dy
                for i in range(side, 1 if still else steps + 1):
                    if i:
                        px += step_x
                        py += step_y
                    # Adding 1.5 before the conversion makes it a floor: one pixel outside becomes -1 instead of 0.
                    ix, iy = int(px + np.float32(1.5)) - 1, int(py + np.float32(1.5)) - 1
                    if ix < 0 or iy < 0 or ix >= width or iy >= height:
                        break
                    if gap[iy, ix] > np.float32(steps - i) * step * _LONGEST + _ONE:
                        break
                    rank = ranks[iy, ix]
                    if rank <= second and rank < UNCOVERED:
                        k = order[rank]
                        allowed = True
                        if guide.enabled and rank != best and rank != second:
                            limit = guide.tolerances[k] * guide.tolerances[k]
                            allowed = _distance2(guide.image, y, x, strokes.targets, k) <= limit
                        if allowed:
                            ox, oy = px - strokes.points[k, 0, 0], py - strokes.points[k, 0, 1]
                            background = (oy * dx - ox * dy) * sign
                            if steps == 0 or still:
                                background = np.sqrt(ox * ox + oy * oy)
                            ahead = ox * dx + oy * dy
                            if abs(background) < strokes.radius_px[k] + _HALF:
                                along = sign * (ahead - step * np.float32(i))
                                if rank < best:
                                    second, second_t, second_s = best, t, s
                                    best, t, s, nearby = rank, background, along, abs(ahead)
                                elif rank == best:
                                    # The visit nearest to the seed gives the most accurate position in the stroke.
                                    if abs(ahead) < nearby:
                                        t, s, nearby = background, along, abs(ahead)
                                elif rank < second:
                                    second, second_t, second_s = rank, background, along
                    nx, ny = tangents[iy, ix, 0], tangents[iy, ix, 1]
                    dot = nx * dx + ny * dy
                    if dot == _ZERO:
                        nx, ny = dx, dy
                    elif dot < _ZERO:
                        nx, ny = -nx, -ny
                    step_x, step_y = step * nx, step * ny
                    if abs(dot) > np.float32(0.8):
                        # Second-order Adams-Bashforth: as many look-ups as Euler's method, and circles stay circles.
                        step_x += _HALF * step * (nx - dx)
                        step_y += _HALF * step * (ny - dy)
                    dx, dy = nx, ny
            if best == UNCOVERED:
                continue
            k = order[best]
            out[y, x] = k
            if second < UNCOVERED and strokes.radius_px[k] + _HALF - abs(t) < _ONE:
                # The edge pixel of a stroke is blended with the stroke below, so that edges are anti-aliased.
                _composite(canvas[y, x], order[second], second_s, second_t, strokes, bristles, streaks)
            _composite(canvas[y, x], k, s, t, strokes, bristles, streaks)


@kernel
def _composite(
    pixel: NDArray[np.float32], k: int, s: np.float32, t: np.float32, strokes: StrokeArrays, bristles: BristleArgs,
    streaks: NDArray[np.float32],
) -> None:  # fmt: skip
    """Composite stroke `k` over the canvas pixel that is `s` px along and `t` px across it."""
    r, g = strokes.radius_px[k], strokes.grain[k]
    a = strokes.opacity[k] * min(max(r + _HALF - abs(t), _ZERO), _ONE)
    t = min(max(t / r, -_ONE), _ONE)
    shade, ridge = _ZERO, _ONE - t * t * t * t
    if g > _ZERO:
        trace = hair(bristles.tile, s, t, r, bristles.offsets[k] & 63, bristles.offsets[k] >> 6)
        shade = g * streaks[k] * (trace - _HALF)
        ridge *= _ONE - g * (_ONE - trace)
    for c in range(3):
        pixel[c] += a * (strokes.colours[k, c] + shade - pixel[c])
        pixel[TARGET + c] += a * (strokes.targets[k, c] - pixel[TARGET + c])
    pixel[HEIGHT] += a * (strokes.relief_px[k] * ridge - pixel[HEIGHT])
