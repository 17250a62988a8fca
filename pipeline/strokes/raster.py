"""Paint strokes on a canvas: thick lines with round ends, anti-aliased, with the traces of hairs, and paint that piles.

Strokes cover each other, so they are painted in order, one after the other: serial work, in Numba.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.segmentation.jit import kernel
from pipeline.strokes.bristles import Tile, hair, tile
from pipeline.strokes.brush import Canvas, Strokes
from pipeline.strokes.random import Ids, Purpose, draws

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_TIP = np.float32(0.3)


@dataclass(frozen=True)
class Touch:
    """How the brush is put down and lifted, alike for all strokes.

    Attributes:
        taper: how much narrower a stroke is at its start and its end, 0..1 each; over three tenths of its length.
        streaks: how far the traces of hairs differ in lightness, gray levels, where the grain is 1.
        dry: how much of the paint is missing between hairs towards the end of a stroke, 0..1, where the grain is 1.
        soft: width over which the edge of an implicit stroke fades, beyond one pixel, in radii: kagaya2011video notes
            softer edges as what calms it. Explicit strokes have edges of one pixel.
    """

    taper: tuple[float, float] = (0.15, 0.6)
    streaks: float = 36.0
    dry: float = 0.6
    soft: float = 0.18


def slopes_of(guide: Frame) -> Plane:
    """How much a picture's colours change in a px, RGB distance: float32 (h, w)."""
    around = np.ones((3, 3), np.uint8)
    span = cv2.subtract(cv2.dilate(guide, around), cv2.erode(guide, around)).astype(np.float32)
    square = span[..., 0] * span[..., 0] + span[..., 1] * span[..., 1] + span[..., 2] * span[..., 2]
    return np.asarray(np.sqrt(square) * _HALF, np.float32)


def painting_order(ids: Ids, seed: int = 0) -> NDArray[np.intp]:
    """Which stroke is painted first: at random by name, so two strokes lie upon each other alike in every frame."""
    return np.argsort(draws(ids, seed, Purpose.ORDER)[:, 0], kind="stable")


def paint(
    canvas: Canvas, strokes: Strokes, *, seed: int = 0, touch: Touch | None = None, guide: Frame | None = None,
    tolerance: float = 80.0, slopes: Plane | None = None, order: NDArray[np.intp] | None = None,
) -> Canvas:  # fmt: skip
    """Paint the strokes on the canvas, in place; returns it.

    Where a stroke covers the part a of a pixel, the pixel becomes its old value + a * opacity * (the stroke's - old),
    its height of paint likewise.

    Args:
        guide: uint8 (h, w, 3): strokes keep off pixels whose colour in the guide is further than `tolerance` from
            theirs (Euclidean in RGB, fading over a quarter of it): clean silhouettes.
        slopes: float32 (h, w), RGB distance that the guide changes by in a px, see `slopes_of`: strokes fade over at
            least so much, so that silhouettes have no stairs; None = 0.
        order: int (n,), which stroke comes first; None = `painting_order`.
    """
    if len(strokes) == 0:
        return canvas
    touch = touch or Touch()
    height, width = canvas.shape[:2]
    turn = painting_order(strokes.ids, seed) if order is None else order
    offset = (draws(strokes.ids, seed, Purpose.BRISTLES)[:, 0] * np.float32(1 << 16)).astype(np.int32)
    scratch, rows = np.zeros((3, height, width), np.float32), np.empty((height, 2), np.int32)
    _paint(
        canvas, strokes.points, strokes.counts, strokes.radius_px, strokes.colours, strokes.aims, strokes.opacity,
        strokes.relief_px, strokes.grain, turn, offset, tile(seed),
        np.zeros((1, 1, 3), np.uint8) if guide is None else guide,
        np.zeros((height, width), np.float32) if slopes is None else slopes,
        guide is not None, np.float32(tolerance), np.float32(touch.taper[0]), np.float32(touch.taper[1]),
        np.float32(touch.streaks), np.float32(touch.dry), scratch, rows,
    )  # fmt: skip
    return canvas


@kernel
def _paint(
    canvas: Canvas, points: NDArray[np.float32], counts: NDArray[np.int32], radius: NDArray[np.float32],
    colours: NDArray[np.float32], aims: NDArray[np.float32], opacity: NDArray[np.float32],
    relief: NDArray[np.float32], grain: NDArray[np.float32], order: NDArray[np.intp], offset: NDArray[np.int32],
    hairs: Tile, guide: Frame, slopes: Plane,
    guided: bool, tolerance: np.float32, taper_start: np.float32, taper_end: np.float32, streaks: np.float32,
    dry: np.float32, scratch: NDArray[np.float32], rows: NDArray[np.int32],
) -> None:  # fmt: skip
    height, width = canvas.shape[:2]
    cover, along, across = scratch[0], scratch[1], scratch[2]
    for k in order:
        n, r = counts[k], radius[k]
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
                            w = r * (_ONE - taper_start * q * q)
                        elif u > _ONE - _TIP:
                            q = _ONE - (_ONE - u) / _TIP
                            w = r * (_ONE - taper_end * q * q)
                    c = min(w + _HALF - d, _ONE)
                    if c > cover[y, x]:
                        cover[y, x] = c
                        along[y, x] = before + s
                        across[y, x] = min(max(t / r, -_ONE), _ONE)
                        rows[y, 0] = min(rows[y, 0], x)
                        rows[y, 1] = max(rows[y, 1], x)
            before += length
        oa, ob = offset[k] & 63, offset[k] >> 6
        red, green, blue = colours[k, 0], colours[k, 1], colours[k, 2]
        aim_r, aim_g, aim_b = aims[k, 0], aims[k, 1], aims[k, 2]
        g, thick, strength = grain[k], relief[k], opacity[k]
        for y in range(top, bottom + 1):
            for x in range(rows[y, 0], rows[y, 1] + 1):
                a = cover[y, x]
                if a <= _ZERO:
                    continue
                cover[y, x] = _ZERO
                a *= strength
                if guided:
                    er = np.float32(guide[y, x, 0]) - aim_r
                    eg = np.float32(guide[y, x, 1]) - aim_g
                    eb = np.float32(guide[y, x, 2]) - aim_b
                    e2 = er * er + eg * eg + eb * eb
                    soft = max(tolerance * np.float32(0.25), slopes[y, x])
                    fit = _HALF + (tolerance * np.float32(1.125) - np.sqrt(e2)) / soft
                    if fit <= _ZERO:
                        continue
                    a *= min(fit, _ONE)
                t = across[y, x]
                shade, ridge = _ZERO, _ONE - t * t * t * t
                if g > _ZERO:
                    trace = hair(hairs, along[y, x], t, r, oa, ob)
                    shade = g * streaks * (trace - _HALF)
                    ridge *= _ONE - g * (_ONE - trace)
                    if total > _ZERO:
                        late = (along[y, x] / total - _HALF) * np.float32(2.0)
                        if late > _ZERO:
                            a *= _ONE - g * dry * late * (_ONE if trace < _HALF * late else _ZERO)
                canvas[y, x, 0] += a * (red + shade - canvas[y, x, 0])
                canvas[y, x, 1] += a * (green + shade - canvas[y, x, 1])
                canvas[y, x, 2] += a * (blue + shade - canvas[y, x, 2])
                canvas[y, x, 3] += a * (thick * ridge - canvas[y, x, 3])
                canvas[y, x, 4] += a * (aim_r - canvas[y, x, 4])
                canvas[y, x, 5] += a * (aim_g - canvas[y, x, 5])
                canvas[y, x, 6] += a * (aim_b - canvas[y, x, 6])
