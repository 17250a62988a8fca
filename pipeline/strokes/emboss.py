"""Light on thick paint: the canvas's height as a bump map, over the weave of the cloth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device
from pipeline.frames import Frame, Plane
from pipeline.segmentation.jit import kernel
from pipeline.strokes.brush import Canvas
from pipeline.strokes.random import Purpose, draws

_SOURCE = Path(__file__).with_suffix(".cl")

WEAVE = 64
"""Side of the weave's tile, px; a power of two, and a multiple of its thread."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)


@dataclass(frozen=True)
class Light:
    """Where light falls from, and what it does.

    Attributes:
        angle_rad: where it comes from in the picture: 0 = right, pi/2 = below.
        strength: change of lightness by a slope of 1, in parts; 0 = no relief.
        gloss: the same for highlights, which only slopes towards the light have.
        weave_px: height of the canvas' weave, px; 0 = smooth.
    """

    angle_rad: float = -2.2
    strength: float = 0.35
    gloss: float = 0.1
    weave_px: float = 0.0


def emboss(canvas: Canvas, light: Light | None = None, device: Device | None = None) -> Frame:
    """The canvas as it looks in the light: uint8 (h, w, 3).

    A pixel's colour is multiplied by 1 + strength * slope towards the light, half at least and 1.6 at most. Paint fills
    the weave: the thicker, the less of it shows.

    Args:
        canvas: float32 (h, w, 4 or more): red, green, blue, height of paint.
        light: None = the default one.
        device: where the kernel runs; None = compiled Python, the specification. The choice changes no bit on a device
            that rounds divisions correctly, as the CPU runtimes do.

    Raises:
        DeviceError: the device failed.

    Source: hertzmann2002fast, sections 2 and 3. Departure: the shading is linear in the slope, so level paint keeps
    its colour whatever the light.
    """
    light = light or Light()
    x, y = np.float32(math.cos(light.angle_rad)), np.float32(math.sin(light.angle_rad))
    traits = x, y, np.float32(light.strength), np.float32(light.gloss), np.float32(light.weave_px)
    if device is not None:
        return _launch(device, canvas, traits)
    out = np.empty((*canvas.shape[:2], 3), np.uint8)
    _emboss(canvas, *traits, weave(), out)
    return out


def _launch(device: Device, canvas: Canvas, traits: tuple[np.float32, ...]) -> Frame:
    height, width, channels = canvas.shape
    out = device.empty((height, width, 3), np.uint8)
    kernel_ = device.kernel(_SOURCE, "emboss")
    kernel_((width, height), device.upload(canvas), device.upload(weave()), out, *traits, channels, width, height)
    return device.download(out)


@cache
def weave(seed: int = 0) -> Plane:
    """Linen, float32 (64, 64), heights in -1..1, repeating: threads of 4 px, none quite even. Read-only."""
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


PAPER = 256
"""Side of the paper's tile, px; a power of two."""


@cache
def paper(seed: int = 0) -> Plane:
    """Cold-pressed paper, float32 (256, 256), heights of mean 0 and deviation 1, repeating. Read-only."""
    noise = draws(np.arange(PAPER * PAPER, dtype=np.uint64), seed, Purpose.WEAVE)[:, 1].reshape(PAPER, PAPER)
    wide = np.pad(noise, 32, mode="wrap")
    total = np.zeros((PAPER, PAPER), np.float32)
    for sigma, weight in ((0.8, 0.6), (1.8, 1.0), (5.0, 0.5)):
        smooth = cv2.GaussianBlur(wide, (0, 0), sigma)[32:-32, 32:-32]
        total += np.float32(weight) * (smooth - smooth.mean()) / smooth.std()
    out = np.asarray(total / total.std(), np.float32)
    out.setflags(write=False)
    return out


def settle_pigment(picture: Frame, rims: Plane, grain: float) -> Frame:
    """Transparent paint as it dries on paper: darker at the rims of wet areas and in the paper's hollows.

    Args:
        picture: uint8 (h, w, 3).
        rims: float32 (h, w), how much darker it is there, 0..1.
        grain: how much darker it is in a hollow of one deviation, where the paint is darkest, 0..1; hills are lighter.
    """
    out = np.empty_like(picture)
    _settle(picture, rims, np.float32(grain), paper(), out)
    return out


@kernel
def _settle(picture: Frame, rims: Plane, grain: np.float32, sheet: Plane, out: Frame) -> None:
    height, width = rims.shape
    for y in range(height):
        for x in range(width):
            hollow = sheet[y & 255, x & 255]
            for c in range(3):
                value = np.float32(picture[y, x, c])
                thick = np.float32(0.3) + np.float32(0.7) * (_ONE - value * np.float32(1 / 255))
                value *= (_ONE - rims[y, x] * thick) * (_ONE - grain * thick * hollow)
                out[y, x, c] = np.uint8(min(max(value + _HALF, _ZERO), np.float32(255.0)))


@kernel
def _emboss(
    canvas: NDArray[np.float32], lx: np.float32, ly: np.float32, strength: np.float32, gloss: np.float32,
    weave_px: np.float32, cloth: Plane, out: Frame,
) -> None:  # fmt: skip
    height, width = canvas.shape[:2]
    level = np.empty((3, width + 2), np.float32)
    for y in range(-1, height + 1):
        row, sy = level[(y + 1) % 3], min(max(y, 0), height - 1)
        for x in range(width):
            paint = canvas[sy, x, 3]
            row[x + 1] = paint + weave_px * cloth[sy & 63, x & 63] / (_ONE + paint + paint)
        row[0], row[width + 1] = row[1], row[width]
        if y < 1:
            continue
        above, own, below = level[(y - 1) % 3], level[y % 3], level[(y + 1) % 3]
        for x in range(width):
            rise_x, rise_y = (own[x + 2] - own[x]) * _HALF, (below[x + 1] - above[x + 1]) * _HALF
            slope = -(rise_x * lx + rise_y * ly)
            shade = min(max(_ONE + strength * slope, np.float32(0.5)), np.float32(1.6))
            shine = gloss * max(slope - np.float32(0.2), _ZERO) * np.float32(255.0)
            for c in range(3):
                value = canvas[y - 1, x, c] * shade + min(shine, np.float32(70.0)) + _HALF
                out[y - 1, x, c] = np.uint8(min(max(value, _ZERO), np.float32(255.0)))
