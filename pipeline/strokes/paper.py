"""Watercolour on paper: pigment gathers in the hollows of the paper and at the edges of wet areas (edge darkening)."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Arrays, State
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.perception.flow.warp import warp_back
from pipeline.strokes.emboss import Painted, pixel_terms
from pipeline.strokes.random import KEPT_TEXTURES, Purpose, draws
from pipeline.strokes.seeds import StyleField

RIM_WIDTH, RIM_STEP = 0.008, 22.0
"""Width of the dark rim as a fraction of the shorter side, and the step of lightness, gray levels, that makes a full
rim."""
FOLLOW = 0.15
"""Fraction of the difference by which rims change per frame, because dried paint does not move."""
_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_1, _2 = np.uintp(1), np.uintp(2)

PAPER = 256
"""Side of the paper's tile, px; a power of two."""


@lru_cache(maxsize=KEPT_TEXTURES)
def paper(seed: int = 0) -> Plane:
    """Height of cold-pressed paper, float32 (256, 256), mean 0, standard deviation 1, tileable. Read-only."""
    noise = draws(np.arange(PAPER * PAPER, dtype=np.uint64), seed, Purpose.WEAVE)[:, 1].reshape(PAPER, PAPER)
    wide = np.pad(noise, 32, mode="wrap")
    total = np.zeros((PAPER, PAPER), np.float32)
    for sigma, weight in ((0.8, 0.6), (1.8, 1.0), (5.0, 0.5)):
        smooth = cv2.GaussianBlur(wide, (0, 0), sigma)[32:-32, 32:-32]
        total += np.float32(weight) * (smooth - smooth.mean()) / smooth.std()
    out = np.asarray(total / total.std(), np.float32)
    out.setflags(write=False)
    return out


def settle_pigment(picture: Painted, rims: Plane, grain: StyleField) -> Painted:
    """Darken transparent paint at the rims of wet areas and in the hollows of the paper.

    Args:
        picture: uint8 or uint16 (h, w, 3).
        rims: float32 (h, w), 0..1, relative darkening.
        grain: relative darkening of the darkest paint at a depth of one standard deviation, 0..1; hills become lighter.
    """
    out = np.empty_like(picture)
    white = np.float32(255 if picture.dtype == np.uint8 else 65535)
    _settle(picture, rims, pixel_terms((grain,), picture.shape)[..., 0], paper(), white, out)
    return out


@kernel
def _settle(picture: Painted, rims: Plane, grain: Plane, heights: Plane, white: np.float32, out: Painted) -> None:
    """`grain`: float32 (h, w) or (1, 1); `white`: its value in the pictures. The loop over a row's colours
    has no branches and vectorises."""
    height, width = rims.shape
    uniform, level = grain.size == 1, np.float32(1) / white
    given, made = picture.reshape(-1), out.reshape(-1)
    rim, depth = np.empty(3 * width, np.float32), np.empty(3 * width, np.float32)
    strength = np.full(3 * width, grain[0, 0])
    for y in range(height):
        for x in range(width):
            at, hollow = np.uintp(3 * x), heights[y & 255, x & 255]
            rim[at], rim[at + _1], rim[at + _2] = rims[y, x], rims[y, x], rims[y, x]
            depth[at], depth[at + _1], depth[at + _2] = hollow, hollow, hollow
        if not uniform:
            for x in range(width):
                strength[3 * x], strength[3 * x + 1], strength[3 * x + 2] = grain[y, x], grain[y, x], grain[y, x]
        for i in range(3 * width):
            at, pixel = np.uintp(i), np.uintp(3 * y * width + i)
            value = np.float32(given[pixel])
            thick = np.float32(0.3) + np.float32(0.7) * (_ONE - value * level)
            value *= (_ONE - rim[at] * thick) * (_ONE - strength[at] * thick * depth[at])
            made[pixel] = np.int32(min(max(value + _HALF, _ZERO), white))


class EdgeDarkening:
    """Computes the dark rims of wet areas for consecutive frames; they are advected with the motion."""

    def __init__(self) -> None:
        self.rims: Plane | None = None

    def step(self, picture: Frame, back: Flow | None, changed: Mask | None) -> NDArray[np.uint8]:
        """Rims of the next frame: uint8 (h, w), 255 = darkest.

        Args:
            picture: uint8 (h, w, 3), the denoised picture.
            back: float32 (h, w, 2), flow from this frame to the one before; None = a shot begins.
            changed: bool (h, w), pixels that show another surface than before.
        """
        now = _rims(picture)
        if back is not None and self.rims is not None and changed is not None:
            past = warp_back(self.rims, back)
            now = np.asarray(past + np.where(changed, np.float32(1), np.float32(FOLLOW)) * (now - past), np.float32)
        self.rims = now
        return np.asarray(np.rint(now * 255), np.uint8)

    def state(self) -> State:
        return {} if self.rims is None else {"rims": self.rims}

    def restore(self, state: Arrays) -> None:
        self.rims = state.get("rims")


def _rims(picture: Frame) -> Plane:
    """Darkening at the darker side of borders, 0..1: difference of two Gaussian blurs of the lightness."""
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    wide = RIM_WIDTH * min(gray.shape)
    difference = cv2.GaussianBlur(gray, (0, 0), wide) - cv2.GaussianBlur(gray, (0, 0), max(wide / 3, 0.5))
    return np.asarray(np.clip(difference * np.float32(1 / RIM_STEP), 0, 1), np.float32)
