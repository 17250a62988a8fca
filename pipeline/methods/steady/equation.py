"""The screened Poisson equation of a steady frame: its terms, and the frame that its solution leads to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.methods.steady.confidence import Picture

DISTRUST = np.float32(1)
"""Weight of the styled frame's colours where the motion cannot be trusted at all."""
FULL_AGE = np.float32(10)
"""Age in frames from which on the past has its full weight."""
LARGEST_AGE = np.float32(40)
"""Largest age. Above FULL_AGE, so that the past survives a single frame of low confidence."""


def equation_terms(
    moved: Picture, styled: Picture, trust: Plane, weight: Plane, back_rate: float, terms: tuple[Plane, Picture],
    background: FrameExecutor = INLINE,
) -> None:  # fmt: skip
    """Fill `terms` with a and b of the equation for x - S, whose solution minimises, over the picture,

        |grad x - grad S|^2  +  w |x - P|^2  +  r w |x - S|^2  +  (1 - c)^2 |x - S - m|^2

    with the styled frame S, the moved previous result P and the mean m of P - S weighted by w.

    Args:
        moved, styled: P and S, float32 (h, w, 3), 0..255.
        trust: the confidence c, float32 (h, w), 0..1.
        weight: w >= 0, float32 (h, w).
        back_rate: r, the rate at which colours return to those of the styled frames.
        terms: a float32 (h, w), b float32 (h, w, 3).
        background: may take rows of them.
    """
    absorb, source = terms
    keep, height = np.float32(1 + back_rate), len(weight)
    by_row: NDArray[np.float64] = np.zeros((height + 1, 4))

    def pull(first: int, last: int) -> None:
        rows = slice(first, last)
        _pull(moved[rows], styled[rows], weight[rows], source[rows], by_row[first + 1 : last + 1])

    background.rows(pull, height)
    sums = by_row.cumsum(axis=0)[-1]  # in the order of the rows, on any number of threads
    mean = (sums[:3] / max(float(keep) * sums[3], 1e-6)).astype(np.float32)

    def distrust(first: int, last: int) -> None:
        rows = slice(first, last)
        _distrust(trust[rows], weight[rows], keep, mean, absorb[rows], source[rows])

    background.rows(distrust, height)


@kernel
def _pull(moved: Any, styled: Any, weight: Any, source: Any, sums: Any) -> None:
    """Fill `source` with w (P - S); fill `sums`, (h, 4), with its sums in each row, and the sum of w."""
    height, width = weight.shape
    for y in range(height):
        r, g, b, total = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for x in range(width):
            w = weight[y, x]
            red, green = w * (moved[y, x, 0] - styled[y, x, 0]), w * (moved[y, x, 1] - styled[y, x, 1])
            blue = w * (moved[y, x, 2] - styled[y, x, 2])
            source[y, x, 0], source[y, x, 1], source[y, x, 2] = red, green, blue
            r, g, b, total = r + red, g + green, b + blue, total + w
        sums[y, 0], sums[y, 1], sums[y, 2], sums[y, 3] = r, g, b, total


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
