"""The screened Poisson equation of a steady frame: its terms, and the frame that its solution leads to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.methods.steady.confidence import Picture

DISTRUST = np.float32(1)
"""Weight of the styled frame's colours where the motion cannot be trusted at all."""
FULL_AGE = np.float32(10)
"""Age in frames from which on the past has its full weight."""
LARGEST_AGE = np.float32(40)
"""Largest age. Above FULL_AGE, so that the past survives a single frame of low confidence."""


def equation_terms(
    moved: Picture, styled: Picture, trust: Plane, weight: Plane, back_rate: float, terms: tuple[Plane, Picture]
) -> None:
    """Fill `terms` with a and b of the equation for x - S, whose solution minimises, over the picture,

        |grad x - grad S|^2  +  w |x - P|^2  +  r w |x - S|^2  +  (1 - c)^2 |x - S - m|^2

    with the styled frame S, the moved previous result P and the mean m of P - S weighted by w.

    Args:
        moved, styled: P and S, float32 (h, w, 3), 0..255.
        trust: the confidence c, float32 (h, w), 0..1.
        weight: w >= 0, float32 (h, w).
        back_rate: r, the rate at which colours return to those of the styled frames.
        terms: a float32 (h, w), b float32 (h, w, 3).
    """
    absorb, source = terms
    keep = np.float32(1 + back_rate)
    sums: NDArray[np.float64] = np.zeros(4)
    _pull(moved, styled, weight, source, sums)
    mean = (sums[:3] / max(float(keep) * sums[3], 1e-6)).astype(np.float32)
    _distrust(trust, weight, keep, mean, absorb, source)


@kernel
def _pull(moved: Any, styled: Any, weight: Any, source: Any, sums: Any) -> None:
    """Fill `source` with w (P - S); add its sums over the picture, and the sum of w, to `sums`."""
    height, width = weight.shape
    for y in range(height):
        r, g, b, total = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for x in range(width):
            w = weight[y, x]
            red, green = w * (moved[y, x, 0] - styled[y, x, 0]), w * (moved[y, x, 1] - styled[y, x, 1])
            blue = w * (moved[y, x, 2] - styled[y, x, 2])
            source[y, x, 0], source[y, x, 1], source[y, x, 2] = red, green, blue
            r, g, b, total = r + red, g + green, b + blue, total + w
        sums[0] += r
        sums[1] += g
        sums[2] += b
        sums[3] += total


@kernel
def _distrust(trust: Any, weight: Any, keep: Any, mean: Any, absorb: Any, source: Any) -> None:
    """Fill `absorb`; add the term of the mean difference to `source`."""
    height, width = weight.shape
    for y in range(height):
        for x in range(width):
            doubt = np.float32(1) - trust[y, x]
            doubt *= doubt * DISTRUST
            absorb[y, x] = weight[y, x] * keep + doubt
            for c in range(3):
                source[y, x, c] += doubt * mean[c]


@kernel
def add_clipped(styled: Any, correction: Any, result: Any) -> None:
    """Fill `result` with styled + correction, limited to 0..255; all float32 (h, w, 3)."""
    height, width, channels = styled.shape
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                value = styled[y, x, c] + correction[y, x, c]
                result[y, x, c] = min(max(value, np.float32(0)), np.float32(255))


@kernel
def show(picture: Any, styled: Any, mask: Any, out: Any) -> None:
    """Fill the uint8 frame `out` with `picture` where `mask` is 1 and with `styled` where it is 0."""
    height, width, channels = picture.shape
    for y in range(height):
        for x in range(width):
            share = mask[y, x]
            for c in range(channels):
                value = styled[y, x, c] + share * (picture[y, x, c] - styled[y, x, c])
                out[y, x, c] = np.uint8(min(max(value, np.float32(0)), np.float32(255)) + np.float32(0.5))


@kernel
def age_weights(age: Any, trust: Any, strength: Any, weight: Any) -> None:
    """Replace `age`, that of the pixels' past along the motion, by its value at this frame; fill `weight` with strength
    c min(age / FULL_AGE, 1)."""
    height, width = age.shape
    for y in range(height):
        for x in range(width):
            c = trust[y, x]
            frames = min((age[y, x] + np.float32(1)) * np.sqrt(np.sqrt(c)), LARGEST_AGE)
            age[y, x] = frames
            weight[y, x] = strength * c * min(frames / FULL_AGE, np.float32(1))


@kernel
def remember(source: Any, expected: Any, weight: Any, memory: Any) -> None:
    """Fill `memory` with the average of the frame `source`, of weight 1, and the expected frame, of weight `weight`."""
    height, width, channels = expected.shape
    for y in range(height):
        for x in range(width):
            share = weight[y, x] / (weight[y, x] + np.float32(1))
            for c in range(channels):
                value = np.float32(source[y, x, c])
                memory[y, x, c] = value + share * (expected[y, x, c] - value)
