"""Weighted sums of pictures and their paintings, in single passes over the memory."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.jit import kernel
from pipeline.methods.patches.paint_error import Rendering

WeightedSum: TypeAlias = NDArray[np.float32]
"""float32 (2, h, w, 3): weighted sum of pictures and of their paintings, RGB."""


def add_weighted(total: WeightedSum, rendering: Rendering, weight: Plane) -> None:
    """Add a picture and its painting to `total`, times the weight of each pixel, float32 (h, w)."""
    for one, plane in zip(total, rendering, strict=True):
        _add(one, plane, weight)


def blended(total: WeightedSum, scale: Plane, layer: WeightedSum, opacity: Plane) -> tuple[Frame, Frame]:
    """`scale` times `total` plus `opacity` times `layer`: picture and painting, uint8 (h, w, 3) each."""
    out = np.empty(total.shape, np.uint8)
    for one, plane, over in zip(out, total, layer, strict=True):
        _blend(plane, scale, over, opacity, one)
    return out[0], out[1]


@kernel
def _add(total: NDArray[np.float32], picture: Frame, weight: Plane) -> None:
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
    total: NDArray[np.float32], scale: Plane, layer: NDArray[np.float32], opacity: Plane, out: Frame
) -> None:  # fmt: skip
    height, width = scale.shape
    least, most, half = np.float32(0), np.float32(255), np.float32(0.5)
    for y in range(height):
        for x in range(width):
            for c in range(3):
                value = scale[y, x] * total[y, x, c] + opacity[y, x] * layer[y, x, c]
                out[y, x, c] = np.uint8(min(max(value, least), most) + half)
