"""Drawing of flat regions and of ink."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Labels
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel

SPAN = 64
"""Pixels of a row that are composited together, or left out if none of them has ink."""


def flat(
    labels: Labels, colours: NDArray[np.uint8], soften_px: float = 0.7, background: FrameExecutor = INLINE
) -> Frame:
    """Fill each region with its colour, and anti-alias boundaries by a Gaussian blur.

    Args:
        labels: int32 (h, w), 0..n.
        colours: uint8 (n + 1, 3), RGB.
        soften_px: standard deviation of the Gaussian, px; 0 = no blur.

    Returns: uint8 (h, w, 3). Pixels beyond the reach of the blur have exactly their region's colour.
    """
    out = np.empty((*labels.shape, 3), np.uint8)
    background.rows(lambda first, last: _flat(labels[first:last], colours, out[first:last]), len(out))
    return np.asarray(cv2.GaussianBlur(out, (3, 3), soften_px), np.uint8) if soften_px > 0 else out


@kernel
def _flat(labels: Labels, colours: NDArray[np.uint8], out: Frame) -> None:
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            label = np.uint64(labels[y, x])  # Numba would test a signed index for its sign
            out[y, x, 0] = colours[label, 0]
            out[y, x, 1] = colours[label, 1]
            out[y, x, 2] = colours[label, 2]


def overlay(
    picture: Frame, ink: NDArray[np.uint8], colour: tuple[int, int, int], opacity: float = 1.0,
    background: FrameExecutor = INLINE,
) -> Frame:  # fmt: skip
    """Composite ink over a picture, in place; returns the picture, uint8 (h, w, 3).

    Args:
        ink: uint8 (h, w), opacity of each pixel, 0..255.
        colour: RGB, 0..255.
        opacity: factor on the ink, 0..1.
    """
    rgb, strength = np.tile(np.array(colour, np.int32), SPAN), round(opacity * 257)
    background.rows(lambda first, last: _overlay(picture[first:last], ink[first:last], rgb, strength), len(picture))
    return picture


@kernel
def _overlay(picture: Frame, ink: NDArray[np.uint8], colours: NDArray[np.int32], opacity: int) -> None:
    """`colours`: int32 (3 * SPAN,), the colour again and again."""
    height, width = ink.shape
    by_byte, factor = np.empty(3 * SPAN, np.int32), np.int32(opacity)
    for y in range(height):
        for start in range(0, width, SPAN):
            part = ink[y, start : start + SPAN]
            if not _has_ink(part):
                continue
            for x in range(part.size):
                by_byte[3 * x] = by_byte[3 * x + 1] = by_byte[3 * x + 2] = np.int32(part[x]) * factor
            pixels = picture[y, start : start + SPAN].reshape(3 * part.size)
            for k in range(pixels.size):  # this vectorises
                p = np.int32(pixels[k])
                pixels[k] = np.uint8(p + (((colours[k] - p) * by_byte[k] + np.int32(32768)) >> np.int32(16)))


@kernel
def _has_ink(part: NDArray[np.uint8]) -> bool:
    found = False
    for x in range(part.size):  # this vectorises
        found |= part[x] != 0
    return found
