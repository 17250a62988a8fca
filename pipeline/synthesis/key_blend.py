"""Blends the pictures that two keyframes give for a frame between them, in the gradient domain.

Source: jamriska2019stylizing, section 3.4: the gradients come from the picture in which each pixel belongs to one
keyframe, the colours from a blend of both keyframes that preserves contrast (heitz2018high), and a screened Poisson
equation joins the two. Departures: the picture is the result of one synthesis instead of two separate ones, and the
blend preserves the variance instead of the whole histogram. The formula for it assumes pictures that have nothing in
common; two keyframes of one shot are alike, and their contrast would rise by up to 41 %. Ours counts what they share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask
from pipeline.solvers.multigrid import Multigrid
from pipeline.synthesis.images import Bytes

STIFFNESS = 0.004
"""Weight of colours relative to gradients, 1/px^2: colours are adjusted over about 1 / sqrt(0.004) = 16 px."""

TOLERANCE = 1e-3
"""Relative residual of the solution."""


@dataclass(frozen=True)
class KeyColours:
    """The picture that one keyframe gives for a frame, and its weight.

    Attributes:
        colours: the keyframe advected along the motion, uint8 (h, w, 3).
        known: pixels that are visible in the keyframe, bool (h, w).
        weight: 0..1; the weights of both keyframes have a sum of 1.
    """

    colours: Bytes
    known: Mask
    weight: float


@dataclass(frozen=True)
class Synthesised:
    """A synthesised frame with the gradients that its pixels have in the keyframes.

    Attributes:
        colours: S^(M(p)), uint8 (h, w, 3).
        right: S^(M(p) + (1, 0)), uint8 (h, w, 3): colour to the right of the pixel in its keyframe.
        below: S^(M(p) + (0, 1)), uint8 (h, w, 3).
    """

    colours: Bytes
    right: Bytes
    below: Bytes


def with_blended_colours(frame: Synthesised, before: KeyColours, after: KeyColours, amount: float) -> Bytes:
    """Adjust the colours of a synthesised frame to the blend of both keyframes, keeping the gradients of its pixels.

    Seams between pixels of different keyframes are no gradients of either, and disappear.

    Args:
        amount: 0 = unchanged, 1 = adjusted completely.

    Returns:
        uint8 (h, w, 3). Its colours are in general no colours of the keyframes.
    """
    known = before.known | after.known
    if not known.any():
        return frame.colours
    picture = frame.colours.astype(np.float64)
    absorb = np.where(known, STIFFNESS, 0.0)
    source = absorb[..., None] * (contrast_preserving_blend(before, after) - picture)
    for axis, neighbour in ((1, frame.right), (0, frame.below)):
        seam = neighbour.astype(np.float64) - picture - np.diff(picture, axis=axis, append=0)
        inner = [slice(None), slice(None)]
        inner[axis] = slice(None, -1)
        outer = [slice(None), slice(None)]
        outer[axis] = slice(1, None)
        source[tuple(inner)] -= seam[tuple(inner)]
        source[tuple(outer)] += seam[tuple(inner)]
    planes = np.ascontiguousarray(np.moveaxis(source, -1, 0))
    system = Multigrid(np.zeros(known.shape, np.bool_), absorb=absorb)
    change = np.moveaxis(system.solve(np.zeros(planes.shape), source=planes, tolerance=TOLERANCE).x, 0, -1)
    return np.asarray(np.rint(picture + amount * change).clip(0, 255), np.uint8)


def contrast_preserving_blend(before: KeyColours, after: KeyColours) -> NDArray[np.float32]:
    """Weighted mean of both keyframes whose deviations from the mean colour keep their size: float32 (h, w, 3).

    Where only one keyframe is known, its colours; where none is, 0.

    Source: heitz2018high, equation 2.
    """
    first, second = before.colours.astype(np.float32), after.colours.astype(np.float32)
    both = before.known & after.known
    a, b = np.float32(before.weight), np.float32(after.weight)
    (mean_1, mean_2), size = _means_and_scale(first, second, both, (before.weight, after.weight))
    blend = a * mean_1 + b * mean_2 + (a * (first - mean_1) + b * (second - mean_2)) / size
    only_first, only_second = before.known & ~both, after.known & ~both
    conditions = [both[..., None], only_first[..., None], only_second[..., None]]
    return np.select(conditions, [blend, first, second], np.float32(0)).astype(np.float32)


def _means_and_scale(
    first: NDArray[np.float32], second: NDArray[np.float32], where: Mask, weights: tuple[float, float]
) -> tuple[tuple[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]:
    """Mean colours of two pictures, and the factor by which their weighted mean has too little contrast, in each
    channel: 1 where they are equal, the root of the sum of squared weights where they have nothing in common."""
    if not where.any():
        return (np.zeros(3, np.float32), np.zeros(3, np.float32)), np.ones(3, np.float32)
    one, two = (colours[where].astype(np.float64) for colours in (first, second))
    means = one.mean(0), two.mean(0)
    one, two = one - means[0], two - means[1]
    (a, b), spreads = weights, (np.sqrt((one**2).mean(0)), np.sqrt((two**2).mean(0)))
    found = np.sqrt(((a * one + b * two) ** 2).mean(0))
    wanted = a * spreads[0] + b * spreads[1]
    scale = np.divide(found, wanted, out=np.ones(3), where=wanted > 0).clip(np.hypot(a, b), 1)
    return (means[0].astype(np.float32), means[1].astype(np.float32)), scale.astype(np.float32)
