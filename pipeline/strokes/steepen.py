"""Steepening of blurred edges, which removes the mixed colours along silhouettes.

An edge of a video is 3 to 5 px wide, and a painter that takes its colours from there paints strokes of mixed colours
along every silhouette. Here each pixel near an edge takes the colour of its darkest or lightest neighbour, whichever is
nearer in lightness, a few times in a row: the toggle mapping of kramer1975iterations, whose choice is made by lightness
so that no false colours appear. Then each pixel beside a step mixes its two colours by the pixel's coverage, which
follows from the blurred picture.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame
from pipeline.kernels.jit import kernel
from pipeline.kernels.nonzero import nonzero_positions

Light = NDArray[np.uint8]


class SteepenParams(NamedTuple):
    """Constants of steepening."""

    least_step: int = 24
    """Range of lightness in 3x3 px below which a pixel keeps its colour, gray levels: noise and shading stay."""
    wide_share: float = 0.9
    """Largest share of the steepened colours at the wide edges of a painting."""
    wide_ranges: tuple[float, float] = 0.6, 0.7
    """Range of lightness in 3x3 px over that in 7x7 px up to which an edge is wide, and from which on it is not."""
    wide_contrast: tuple[int, int] = 64, 112
    """Ranges of lightness in 7x7 px up to which no edge is steepened as a wide one, and from which on it is in full."""


STEEPEN = SteepenParams()


_SQUARE, _WIDE_SQUARE = np.ones((3, 3), np.uint8), np.ones((7, 7), np.uint8)


def steepen(picture: Frame, steps: int) -> Frame:
    """The picture with blurred edges made one to two pixels wide, uint8 (h, w, 3).

    Args:
        picture: uint8 (h, w, 3), RGB.
        steps: number of iterations, about the width of the edges, px; 0 returns `picture` itself.
    """
    if steps <= 0:
        return picture
    smooth = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
    sharp, light = picture, smooth
    for _ in range(steps):
        out, out_light = sharp.copy(), light.copy()
        _toggle(sharp, light, *_range(light), out, out_light)
        sharp, light = out, out_light
    out = sharp.copy()
    _anti_alias(sharp, light, *_range(light), smooth, out)
    return out


def steepen_wide(colours: NDArray[np.float32], steps: int, share: float = 1.0) -> None:
    """Make the wide edges of a painting steeper, in place; narrow edges and texture keep their colours.

    Args:
        colours: float32 (h, w, 3 or more): red, green, blue, 0..255, and other channels, which are not read.
        steps: as for `steepen`.
        share: factor on the share of the steepened colours, 0..1.
    """
    picture = np.empty((*colours.shape[:2], 3), np.uint8)
    _rounded(colours, picture)
    light = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
    most, least = _range(light)
    wide_most, wide_least = _range(light, _WIDE_SQUARE)
    _mix_wide(colours, steepen(picture, steps), most - least, wide_most - wide_least, np.float32(share))


def steepened_wide(picture: Frame, steps: int, share: float) -> Frame:
    """The picture with its wide edges made steeper, uint8 (h, w, 3); narrow edges and texture keep their colours.

    Args:
        picture: uint8 (h, w, 3), RGB.
        steps: as for `steepen`.
        share: factor on the share of the steepened colours, 0..1.
    """
    light = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
    most, least = _range(light)
    wide_most, wide_least = _range(light, _WIDE_SQUARE)
    out = picture.copy()
    _mix_wide_bytes(out, steepen(picture, steps), most - least, wide_most - wide_least, np.float32(share))
    return out


def _range(light: Light, square: NDArray[np.uint8] = _SQUARE) -> tuple[Light, Light]:
    """Largest and smallest lightness in 3x3 px, or in another square: uint8 (h, w) each."""
    return np.asarray(cv2.dilate(light, square), np.uint8), np.asarray(cv2.erode(light, square), np.uint8)


@kernel
def _rounded(colours: NDArray[np.float32], out: Frame) -> None:
    height, width, channels = out.shape
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                out[y, x, c] = np.uint8(min(max(colours[y, x, c], np.float32(0)), np.float32(255)) + np.float32(0.5))


@kernel
def _mix_wide(colours: NDArray[np.float32], steep: Frame, near: Light, wide: Light, factor: np.float32) -> None:
    """Mix in the steepened colours. `near`, `wide`: range of lightness in 3x3 and in 7x7 px; a factor on the share."""
    height, width = near.shape
    for y in range(height):
        for x in range(width):
            share = factor * _wide_share(near[y, x], wide[y, x])
            if share > 0:
                for c in range(3):
                    colours[y, x, c] += share * (steep[y, x, c] - colours[y, x, c])


@kernel
def _mix_wide_bytes(picture: Frame, steep: Frame, near: Light, wide: Light, factor: np.float32) -> None:
    """The same for a picture of bytes."""
    height, width = near.shape
    for y in range(height):
        for x in range(width):
            share = factor * _wide_share(near[y, x], wide[y, x])
            if share > 0:
                for c in range(3):
                    before, after = np.float32(picture[y, x, c]), np.float32(steep[y, x, c])
                    picture[y, x, c] = np.uint8(before + share * (after - before) + np.float32(0.5))


@kernel
def _wide_share(near: int, wide: int) -> np.float32:
    """Share of the steepened colours, 0..1. `near`, `wide`: range of lightness in 3x3 and in 7x7 px."""
    (narrowest, limit), (low, high) = STEEPEN.wide_ranges, STEEPEN.wide_contrast
    ratio, contrast = np.float32(near) / max(wide, 1), np.float32(wide)
    if ratio >= limit or contrast <= low:
        return np.float32(0)
    share = np.float32(STEEPEN.wide_share) * min((limit - ratio) / (limit - narrowest), np.float32(1))
    share *= min((contrast - low) / (high - low), np.float32(1))
    return np.float32(share)


@kernel
def _toggle(picture: Frame, light: Light, most: Light, least: Light, out: Frame, out_light: Light) -> None:
    """One step. `out` and `out_light` are copies of `picture` and `light`: only pixels that change are written."""
    height, width = light.shape
    changes, places = np.zeros(width, np.uint8), np.empty(width, np.int32)
    for y in range(height):
        here, high, low = light[y], most[y], least[y]
        for x in range(width):  # this vectorises
            up, down = np.uint8(high[x] - here[x]), np.uint8(here[x] - low[x])
            between = (up > 0) & (down > 0) & (up != down)
            changes[x] = np.uint8(between & (np.uint8(high[x] - low[x]) >= STEEPEN.least_step))
        for x in places[: nonzero_positions(changes, places)]:
            nearer = high[x] if high[x] - here[x] < here[x] - low[x] else low[x]
            row, column = _neighbour(light, y, x, nearer)
            out_light[y, x] = light[row, column]
            for c in range(3):
                out[y, x, c] = picture[row, column, c]


@kernel
def _anti_alias(sharp: Frame, light: Light, most: Light, least: Light, smooth: Light, out: Frame) -> None:
    """Beside a step, mix its two colours by the coverage of the pixel: the distance to where the lightness of the
    picture before (`smooth`) crosses the middle, in px. `out` is a copy of `sharp`: only pixels that change are
    written."""
    height, width = light.shape
    half = np.float32(0.5)
    steps, places = np.zeros(width, np.uint8), np.empty(width, np.int32)
    for y in range(height):
        high_row, low_row = most[y], least[y]
        for x in range(width):  # this vectorises
            steps[x] = np.uint8(np.uint8(high_row[x] - low_row[x]) >= STEEPEN.least_step)
        for x in places[: nonzero_positions(steps, places)]:
            low, span = np.float32(least[y, x]), np.float32(most[y, x]) - np.float32(least[y, x])
            right, left = np.float32(smooth[y, min(x + 1, width - 1)]), np.float32(smooth[y, max(x - 1, 0)])
            below, above = np.float32(smooth[min(y + 1, height - 1), x]), np.float32(smooth[max(y - 1, 0), x])
            slope = half * np.sqrt((right - left) * (right - left) + (below - above) * (below - above))
            over = np.float32(smooth[y, x]) - low - half * span
            cover = min(max(half + over / max(slope, np.float32(1)), np.float32(0)), np.float32(1))
            j, i = _neighbour(light, y, x, least[y, x])
            n, m = _neighbour(light, y, x, most[y, x])
            for c in range(3):
                dark, bright = np.float32(sharp[j, i, c]), np.float32(sharp[n, m, c])
                out[y, x, c] = np.uint8(dark + cover * (bright - dark) + half)


@kernel
def _neighbour(light: Light, y: int, x: int, wanted: int) -> tuple[int, int]:
    """Row and column of the last pixel in 3x3 px around (x, y) with that lightness."""
    for j in range(min(y + 1, light.shape[0] - 1), max(y - 1, 0) - 1, -1):
        for i in range(min(x + 1, light.shape[1] - 1), max(x - 1, 0) - 1, -1):
            if light[j, i] == wanted:
                return j, i
    return y, x
