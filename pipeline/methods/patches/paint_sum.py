"""Weighted sums of pictures and their paintings, in single passes over the memory."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.methods.patches.paint_error import Rendering
from pipeline.video.depth import FULL

WeightedSum: TypeAlias = NDArray[np.float32]
"""float32 (2, h, w, 3): weighted sum of pictures and of their paintings, RGB, in the levels of their types."""


def add_weighted(total: WeightedSum, rendering: Rendering, weight: Plane) -> None:
    """Add a picture and its painting to `total`, times the weight of each pixel, float32 (h, w)."""
    for one, plane in zip(total, rendering, strict=True):
        _add(one, plane, weight)


def blended(
    total: WeightedSum, covered: Plane, layer: WeightedSum, opacity: Plane, deep: bool = False
) -> Rendering:  # fmt: skip
    """The mean of `total` under `layer`: picture and painting.

    Args:
        covered: float32 (h, w), sum of the weights in `total`.
        opacity: float32 (h, w), 0..1, opacity of `layer`.
        deep: whether paintings are uint16.
    """
    out = [np.empty(total.shape[1:], dtype) for dtype in (np.uint8, np.uint16 if deep else np.uint8)]
    for one, plane, over in zip(out, total, layer, strict=True):
        _blend(plane, covered, over, opacity, np.float32(FULL[one.dtype]), one)
    return out[0], out[1]


@kernel
def _add(total: NDArray[np.float32], picture: AnyArray, weight: Plane) -> None:
    height, width = weight.shape
    for y in range(height):
        for x in range(width):
            share = weight[y, x]
            if share != 0:
                total[y, x, 0] += share * np.float32(picture[y, x, 0])
                total[y, x, 1] += share * np.float32(picture[y, x, 1])
                total[y, x, 2] += share * np.float32(picture[y, x, 2])


@kernel
def _blend(
    total: NDArray[np.float32], covered: Plane, layer: NDArray[np.float32], opacity: Plane, white: np.float32,
    out: AnyArray,
) -> None:  # fmt: skip
    height, width = covered.shape
    least, half = np.float32(0), np.float32(0.5)
    for y in range(height):
        for x in range(width):
            over = opacity[y, x]
            scale = (np.float32(1) - over) / max(covered[y, x], np.float32(1e-6))
            for c in range(3):
                value = scale * total[y, x, c] + over * layer[y, x, c]
                out[y, x, c] = np.int32(min(max(value, least), white) + half)
