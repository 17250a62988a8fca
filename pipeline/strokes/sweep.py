"""Implicit strokes: discs of colour, drawn out along the orientation field; the order of colours says who covers whom.

kagaya2011video draws the seeds as discs C_0, and repeats C_(i+1) = f(C_i warped along the field, C_0), where f takes
the smaller colour (eq. 5). The minimum is associative and f leaves what is not covered alone, so C_n(p) is the
smallest of C_0 along the streamline through p. Here each pixel walks that streamline, once, in both directions.
Nothing is warped again and again, so nothing blurs; and what is compared is the stroke's rank in the order of colours,
not the colour, so a pixel knows whose stroke it is in, and where in it: it can have the traces of its hairs, and
relief. Where the paper's strokes are stamps one step apart, these have straight, anti-aliased sides.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device
from pipeline.frames import Frame, Plane
from pipeline.segmentation.jit import kernel
from pipeline.strokes.bristles import Tile, hair, tile
from pipeline.strokes.brush import Canvas, Direction, Strokes
from pipeline.strokes.random import Purpose, draws
from pipeline.strokes.raster import Touch
from pipeline.strokes.seeds import Field, as_plane
from pipeline.strokes.trace import tangent

_SOURCE = Path(__file__).with_suffix(".cl")

Ranks = NDArray[np.int32]
"""The stroke that covers each pixel, `int32` (height, width): its rank in the order of colours, or `OPEN`."""

OPEN = np.iinfo(np.int32).max
"""Where no stroke is: greater than any rank."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)

_NO_GUIDE: Frame = np.zeros((1, 1, 3), np.uint8)

_LONGEST = np.float32(1.15)
"""A step of second order is at most by this factor longer than the nominal one: where directions turn by 37 degrees."""


def colour_order(colours: NDArray[np.float32]) -> NDArray[np.intp]:
    """Indices of RGB colours (n, 3) from the smallest: by R^2 + G^2 + B^2, then by G, then R, then B.

    Source: kagaya2011video, eq. 5 and after. Equal colours keep their order.
    """
    whole = np.rint(colours).astype(np.int64)
    return np.lexsort((whole[:, 2], whole[:, 0], whole[:, 1], (whole * whole).sum(axis=1)))


def sweep(
    canvas: Canvas, starts: Strokes, field: Direction, length_px: Field, *, seed: int = 0, touch: Touch | None = None,
    guide: Frame | None = None, tolerance: float = 80.0, light_first: bool = False, threads: int = 1,
    order: NDArray[np.intp] | None = None, device: Device | None = None,
) -> Ranks:  # fmt: skip
    """Paint strokes along the field on the canvas, in place.

    Args:
        starts: one point a stroke (see `discs`).
        field: float32 (h, w, 2): (cos 2a, sin 2a) of the orientation.
        length_px: of strokes from tip to tip.
        guide, tolerance: as in `paint`: strokes keep off pixels of another colour.
        light_first: True turns the order of colours round: light strokes cover dark ones.
        threads: the picture is cut into so many bands of rows; the result is the same.
        order: indices of the strokes, who covers whom, the uppermost first; None = by `colour_order`. Strokes that live
            on keep theirs: where the order follows the picture's colours, neighbours change places all the time.
        device: where pixels walk; None = compiled Python, the specification. The choice changes no bit on a device that
            rounds divisions correctly, as the CPU runtimes do. Discs are stamped by the host: they cover each other.

    Raises:
        DeviceError: the device failed.

    Returns: whose stroke is where, as an index into `starts`, or `OPEN`; before opacity.
    """
    shape = canvas.shape[:2]
    out = np.full(shape, OPEN, np.int32)
    if len(starts) == 0:
        return out
    touch, order = touch or Touch(), colour_order(starts.colours) if order is None else order
    order = np.ascontiguousarray(order[::-1] if light_first else order)
    guided, guide, limit = guide is not None, _NO_GUIDE if guide is None else guide, np.float32(tolerance)
    offset = (draws(starts.ids, seed, Purpose.BRISTLES)[:, 0] * np.float32(1 << 16)).astype(np.int32)
    lengths, hairs = np.ascontiguousarray(as_plane(length_px, shape)), tile(seed)
    step = np.float32(max(float(np.median(starts.radius_px)) * 1.1, 1.0))
    first = _stamp(starts, order, step, lengths, guide, guided, limit)
    away = _distance(first)
    if device is not None:
        limits = int(guided), limit, np.float32(touch.streaks), step
        return _launch(device, canvas, starts, (first, field, lengths, away), order, offset, hairs, guide, limits)
    way = np.empty((*shape, 2), np.float32)
    _ways(field, way)

    def band(top: int, bottom: int) -> None:
        _sweep(
            first, way, lengths, step, starts.points, starts.radius_px, starts.colours, starts.aims,
            starts.opacity, starts.relief_px, starts.grain, order, offset, hairs, guide, guided, limit,
            np.float32(touch.streaks),
            away, canvas, out, top, bottom,
        )  # fmt: skip

    edges = [shape[0] * i // threads for i in range(threads + 1)]
    if threads == 1:
        band(0, shape[0])
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(band, edges[:-1], edges[1:]))
    return out


def _launch(
    device: Device, canvas: Canvas, starts: Strokes, planes: tuple[NDArray[np.generic], ...],
    order: NDArray[np.intp], offset: NDArray[np.int32], hairs: Tile, guide: Frame,
    limits: tuple[int | np.float32, ...],
) -> Ranks:  # fmt: skip
    height, width = canvas.shape[:2]
    first, field, lengths, away = (device.upload(plane) for plane in planes)
    way = device.empty((height, width, 2))
    device.kernel(_SOURCE, "ways")((width, height), field, way, width, height)
    traits = np.stack([starts.radius_px, starts.opacity, starts.relief_px, starts.grain], axis=1)
    strokes = (starts.points[:, 0], starts.colours, starts.aims, traits, order.astype(np.int32), offset, hairs, guide)
    uploaded = [device.upload(array) for array in strokes]
    painted, out = device.upload(canvas), device.upload(np.full((height, width), OPEN, np.int32))
    device.kernel(_SOURCE, "sweep")(
        (width, height), first, way, lengths, away, *uploaded, *limits, painted, out, width, height
    )
    canvas[...] = device.download(painted)
    return device.download(out)


def _stamp(
    starts: Strokes, order: NDArray[np.intp], step: np.float32, lengths: Plane, guide: Frame, guided: bool,
    limit: np.float32,
) -> Ranks:  # fmt: skip
    """The discs, C_0. Larger than the strokes, so that two a step apart fill a strip of their width: `_sweep` trims."""
    first = np.full(lengths.shape, OPEN, np.int32)
    overlap = step * _HALF if lengths.max() * _HALF >= step else _ZERO
    radius = np.sqrt((starts.radius_px + _HALF) ** 2 + overlap * overlap).astype(np.float32)
    _discs(starts.points, radius, starts.aims, order, guide, guided, limit * limit, first)
    return first


def _distance(first: Ranks) -> Plane:
    """How far, at least, the next disc is from each pixel, px: walks that cannot come to one are not walked.

    By OpenCV's 5 x 5 mask, which is right to 2 %, less 5 %.
    """
    away = cv2.distanceTransform((first == OPEN).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(away * np.float32(0.95), np.float32)


@kernel
def _discs(
    points: NDArray[np.float32], radius: NDArray[np.float32], aims: NDArray[np.float32], order: NDArray[np.intp],
    guide: Frame, guided: bool, limit2: np.float32, first: Ranks,
) -> None:  # fmt: skip
    height, width = first.shape
    for rank in range(len(order)):
        k = order[rank]
        x0, y0, r = points[k, 0, 0], points[k, 0, 1], radius[k]
        for y in range(max(int(np.ceil(y0 - r)), 0), min(int(np.floor(y0 + r)), height - 1) + 1):
            dy = np.float32(y) - y0
            half = np.sqrt(max(r * r - dy * dy, _ZERO))
            for x in range(max(int(np.ceil(x0 - half)), 0), min(int(np.floor(x0 + half)), width - 1) + 1):
                if first[y, x] <= rank:
                    continue
                if guided:
                    er = np.float32(guide[y, x, 0]) - aims[k, 0]
                    eg = np.float32(guide[y, x, 1]) - aims[k, 1]
                    eb = np.float32(guide[y, x, 2]) - aims[k, 2]
                    if er * er + eg * eg + eb * eb > limit2:
                        continue
                first[y, x] = rank


@kernel
def _ways(field: Direction, way: NDArray[np.float32]) -> None:
    height, width = field.shape[:2]
    for y in range(height):
        for x in range(width):
            tx, ty = tangent(field[y, x, 0], field[y, x, 1], _ZERO, _ZERO)
            way[y, x, 0], way[y, x, 1] = tx, ty


@kernel
def _sweep(
    first: Ranks, way: NDArray[np.float32], lengths: Plane, step: np.float32, points: NDArray[np.float32],
    radius: NDArray[np.float32], colours: NDArray[np.float32], aims: NDArray[np.float32],
    opacity: NDArray[np.float32], relief: NDArray[np.float32], grain: NDArray[np.float32], order: NDArray[np.intp],
    offset: NDArray[np.int32], hairs: Tile, guide: Frame, guided: bool, limit: np.float32, streaks: np.float32,
    away: Plane, canvas: Canvas, out: Ranks, top: int, bottom: int,
) -> None:  # fmt: skip
    height, width = first.shape
    outer2 = limit * limit
    for y in range(top, bottom):
        for x in range(width):
            if away[y, x] > lengths[y, x] * _HALF * _LONGEST + _ONE:
                continue
            best, second = OPEN, OPEN
            t, s, nearby = _ZERO, _ZERO, _ZERO
            second_t, second_s = _ZERO, _ZERO
            steps = int(lengths[y, x] * _HALF / step)
            start_x, start_y = way[y, x, 0], way[y, x, 1]
            still = start_x == _ZERO and start_y == _ZERO
            for side in range(2):
                sign = np.float32(1 - 2 * side)
                px, py, dx, dy = np.float32(x), np.float32(y), start_x * sign, start_y * sign
                step_x, step_y = step * dx, step * dy
                for i in range(side, 1 if still else steps + 1):
                    if i:
                        px += step_x
                        py += step_y
                    # Adding before the cut keeps it a floor: one pixel outside is -1, not 0.
                    ix, iy = int(px + np.float32(1.5)) - 1, int(py + np.float32(1.5)) - 1
                    if ix < 0 or iy < 0 or ix >= width or iy >= height:
                        break
                    if away[iy, ix] > np.float32(steps - i) * step * _LONGEST + _ONE:
                        break
                    rank = first[iy, ix]
                    if rank <= second and rank < OPEN:
                        k = order[rank]
                        allowed = True
                        if guided and rank != best and rank != second:
                            er = np.float32(guide[y, x, 0]) - aims[k, 0]
                            eg = np.float32(guide[y, x, 1]) - aims[k, 1]
                            eb = np.float32(guide[y, x, 2]) - aims[k, 2]
                            allowed = er * er + eg * eg + eb * eb <= outer2
                        if allowed:
                            ox, oy = px - points[k, 0, 0], py - points[k, 0, 1]
                            aside = (oy * dx - ox * dy) * sign
                            if steps == 0 or still:
                                aside = np.sqrt(ox * ox + oy * oy)
                            ahead = ox * dx + oy * dy
                            if abs(aside) < radius[k] + _HALF:
                                along = sign * (ahead - step * np.float32(i))
                                if rank < best:
                                    second, second_t, second_s = best, t, s
                                    best, t, s, nearby = rank, aside, along, abs(ahead)
                                elif rank == best:
                                    # Of its places on the way, the one beside its seed tells best where in it this is.
                                    if abs(ahead) < nearby:
                                        t, s, nearby = aside, along, abs(ahead)
                                elif rank < second:
                                    second, second_t, second_s = rank, aside, along
                    nx, ny = way[iy, ix, 0], way[iy, ix, 1]
                    dot = nx * dx + ny * dy
                    if dot == _ZERO:
                        nx, ny = dx, dy
                    elif dot < _ZERO:
                        nx, ny = -nx, -ny
                    step_x, step_y = step * nx, step * ny
                    if abs(dot) > np.float32(0.8):
                        # Adams-Bashforth's second order: as many look-ups as Euler's, and circles stay circles.
                        step_x += _HALF * step * (nx - dx)
                        step_y += _HALF * step * (ny - dy)
                    dx, dy = nx, ny
            if best == OPEN:
                continue
            k = order[best]
            out[y, x] = k
            if second < OPEN and radius[k] + _HALF - abs(t) < _ONE:
                # At a stroke's very edge the next one shows, so that edges between strokes are smooth as well.
                _lay(
                    canvas, y, x, order[second], second_s, second_t, colours, aims, opacity, relief, grain, radius,
                    offset, hairs, streaks,
                )  # fmt: skip
            _lay(
                canvas, y, x, k, s, t, colours, aims, opacity, relief, grain, radius, offset, hairs, streaks,
            )  # fmt: skip


@kernel
def _lay(
    canvas: Canvas, y: int, x: int, k: int, s: np.float32, t: np.float32, colours: NDArray[np.float32],
    aims: NDArray[np.float32], opacity: NDArray[np.float32], relief: NDArray[np.float32], grain: NDArray[np.float32],
    radius: NDArray[np.float32], offset: NDArray[np.int32], hairs: Tile, streaks: np.float32,
) -> None:  # fmt: skip
    """Lay stroke `k` over the pixel, which is `s` along and `t` px across it."""
    r, g = radius[k], grain[k]
    a = opacity[k] * min(max(r + _HALF - abs(t), _ZERO), _ONE)
    t = min(max(t / r, -_ONE), _ONE)
    shade, ridge = _ZERO, _ONE - t * t * t * t
    if g > _ZERO:
        trace = hair(hairs, s, t, r, offset[k] & 63, offset[k] >> 6)
        shade = g * streaks * (trace - _HALF)
        ridge *= _ONE - g * (_ONE - trace)
    for c in range(3):
        canvas[y, x, c] += a * (colours[k, c] + shade - canvas[y, x, c])
        canvas[y, x, 4 + c] += a * (aims[k, c] - canvas[y, x, 4 + c])
    canvas[y, x, 3] += a * (relief[k] * ridge - canvas[y, x, 3])
