"""Lighting of thick paint: the paint height is a bump map over the weave of the canvas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.brush import HEIGHT, Canvas
from pipeline.strokes.random import Purpose, draws
from pipeline.strokes.seeds import StyleField

Painted: TypeAlias = NDArray[Any]
"""A painted frame, uint8 or uint16 (height, width, 3)."""
WEAVE = 64
"""Side of the weave's tile, px; a power of two, and a multiple of the thread width."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_STRENGTH, _GLOSS, _WEAVE = range(3)
"""Channels of the terms that `_emboss` reads."""


@dataclass(frozen=True)
class Lighting:
    """Direction and strength of the light.

    Attributes:
        angle_rad: direction that the light comes from: 0 = right, pi/2 = below.
        strength, gloss, weave_px: numbers, or float32 (h, w).
        strength: relative change of lightness at a slope of 1; 0 = no relief.
        gloss: strength of highlights, which appear on slopes towards the light.
        weave_px: height of the canvas weave, px; 0 = smooth.
    """

    angle_rad: float = -2.2
    strength: StyleField = 0.35
    gloss: StyleField = 0.1
    weave_px: StyleField = 0.0


def emboss(canvas: Canvas, light: Lighting | None = None, deep: bool = False) -> Painted:
    """Shade the canvas: uint8 (h, w, 3); uint16, if `deep`.

    Colours are multiplied by 1 + strength * slope towards the light, limited to 0.5..1.6. Thick paint fills the weave.

    Args:
        canvas: float32 (h, w, 4 or more): red, green, blue, paint height in px.
        light: None = defaults.

    Source: hertzmann2002fast, sections 2 and 3. Departure: shading is linear in the slope, so that level paint keeps
    its colour under any light.
    """
    light = light or Lighting()
    x, y = np.float32(math.cos(light.angle_rad)), np.float32(math.sin(light.angle_rad))
    terms = pixel_terms((light.strength, light.gloss, light.weave_px), canvas.shape)
    out: Painted = np.empty((*canvas.shape[:2], 3), np.uint16 if deep else np.uint8)
    white = np.float32(65535 if deep else 255)
    _emboss(canvas, (x, y), terms, bool(terms[..., _WEAVE].max() > 0), weave(), (white, white / np.float32(255)), out)
    return out


def pixel_terms(fields: Sequence[StyleField], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Stack style parameters: float32 (1, 1, n) if all are uniform, otherwise (h, w, n)."""
    planes = [np.asarray(field, np.float32) for field in fields]
    size = shape[:2] if any(plane.ndim for plane in planes) else (1, 1)
    return np.ascontiguousarray(np.stack([np.broadcast_to(plane, size) for plane in planes], axis=-1))


@cache
def weave(seed: int = 0) -> Plane:
    """Height of a linen weave, float32 (64, 64), -1..1, seamlessly repeating, threads of 4 px. Read-only."""
    y, x = np.indices((WEAVE, WEAVE))
    over = ((x // 4 + y // 4) % 2).astype(np.float32)
    across, down = (np.abs(y % 4 - 1.5) / 1.5, np.abs(x % 4 - 1.5) / 1.5)
    threads = over * (1 - across**2) + (1 - over) * (1 - down**2)
    noise = draws(np.arange(WEAVE * WEAVE, dtype=np.uint64), seed, Purpose.WEAVE)[:, 0].reshape(WEAVE, WEAVE)
    rough = cv2.GaussianBlur(np.pad(noise, 8, mode="wrap"), (0, 0), 1.5)[8:-8, 8:-8]
    both = cv2.GaussianBlur(np.pad(threads.astype(np.float32), 8, mode="wrap"), (0, 0), 0.8)[8:-8, 8:-8]
    both = both / np.ptp(both) + rough / np.ptp(rough)
    out = np.asarray((both - both.min()) / np.ptp(both) * 2 - 1, np.float32)
    out.setflags(write=False)
    return out


@kernel
def _emboss(
    canvas: NDArray[np.float32], towards: tuple[np.float32, np.float32], terms: NDArray[np.float32], woven: bool,
    cloth: Plane, scale: tuple[np.float32, np.float32], out: Painted,
) -> None:  # fmt: skip
    """`towards`: unit vector to the light; `terms`: float32 (h, w, 3) or (1, 1, 3), see `_STRENGTH`; `woven`: whether
    any pixel has a weave; `scale`: value of white in `out`, and of one of its 255 levels. (A maximum in here would
    make Numba import linear algebra: 0.2 s at every start.)"""
    height, width, channels = canvas.shape
    (lx, ly), (white, step) = towards, scale
    # Flat arrays with unsigned indices, and loops without branches, which vectorise.
    colours, picture = canvas.reshape(-1), out.reshape(-1)
    uniform = terms.shape[0] * terms.shape[1] == 1
    level = np.empty((3, width + 2), np.float32)
    strength, gloss = np.full(width, terms[0, 0, _STRENGTH]), np.full(width, terms[0, 0, _GLOSS])
    line = np.empty(3 * width, np.float32)
    shade, shine = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(-1, height + 1):
        row, sy = level[(y + 1) % 3], min(max(y, 0), height - 1)
        for x in range(width):
            row[np.uintp(x + 1)] = colours[np.uintp((sy * width + x) * channels + HEIGHT)]
        if woven:
            for x in range(width):
                paint, weave_px = row[x + 1], terms[0 if uniform else sy, 0 if uniform else x, _WEAVE]
                row[x + 1] = paint + weave_px * cloth[sy & 63, x & 63] / (_ONE + paint + paint)
        row[0], row[width + 1] = row[1], row[width]
        if y < 1:
            continue
        if not uniform:
            for x in range(width):
                strength[x], gloss[x] = terms[y - 1, x, _STRENGTH], terms[y - 1, x, _GLOSS]
        above, own, below = level[(y - 1) % 3], level[y % 3], level[(y + 1) % 3]
        for x in range(width):
            at = np.uintp(x)
            rise_x = (own[np.uintp(x + 2)] - own[at]) * _HALF
            rise_y = (below[np.uintp(x + 1)] - above[np.uintp(x + 1)]) * _HALF
            slope = -(rise_x * lx + rise_y * ly)
            shade[at] = min(max(_ONE + strength[at] * slope, np.float32(0.5)), np.float32(1.6))
            light = gloss[at] * max(slope - np.float32(0.2), _ZERO) * np.float32(255.0)
            shine[at] = min(light, np.float32(70.0))
        start = (y - 1) * width
        for x in range(width):
            pixel, place = np.uintp((start + x) * channels), np.uintp(3 * x)
            mine, plus = shade[np.uintp(x)], shine[np.uintp(x)]
            line[place] = (colours[pixel] * mine + plus) * step + _HALF
            line[place + np.uintp(1)] = (colours[pixel + np.uintp(1)] * mine + plus) * step + _HALF
            line[place + np.uintp(2)] = (colours[pixel + np.uintp(2)] * mine + plus) * step + _HALF
        for i in range(3 * width):
            value = min(max(line[np.uintp(i)], _ZERO), white)
            picture[np.uintp(3 * start + i)] = np.int32(value)
