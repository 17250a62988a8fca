"""What synthesis works on: style and target as packed bytes, at one level of a pyramid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.synthesis.goal import Goal

Bytes: TypeAlias = NDArray[np.uint8]
Offsets: TypeAlias = NDArray[np.float32]
"""A place in the style for each pixel, float32 (h, w, 2): (x, y) px; x <= NOWHERE = none."""
NOWHERE = np.float32(-1e6)
TAIL = 64
"""Bytes after an image, since the last patch's last vector reads beyond it."""


@dataclass(frozen=True)
class Style:
    """A style image (or several side by side) at one level."""

    colours: Bytes
    """S^, uint8 (h, w, 3), or (h, w, 4) with straight opacity: what the result is made of."""
    features: Bytes
    """uint8 (h, w, channels): S^ in the colour space that patches are compared in, then S's guides, then zeros."""
    bins: Bytes | None = None
    """Direction of each pixel, uint8 (h, w); None = patches are not turned."""
    usable: Bytes | None = None
    """0 where a pixel must not be used; None = all may be."""
    distance: Plane | None = None
    """Distance to the style's lines, px; None = no lines."""

    @property
    def size(self) -> tuple[int, int]:
        return self.colours.shape[1], self.colours.shape[0]

    @property
    def first(self) -> tuple[int, int]:
        """A place that may be used."""
        if self.usable is None:
            return 0, 0
        y, x = np.unravel_index(int(self.usable.argmax()), self.usable.shape)
        return int(x), int(y)


@dataclass(frozen=True)
class Target:
    """A frame at one level."""

    guides: Bytes
    """I, uint8 (h, w, guide channels)."""
    bins: Bytes | None = None
    distance: Plane | None = None

    @property
    def size(self) -> tuple[int, int]:
        return self.guides.shape[1], self.guides.shape[0]


def packed(goal: Goal, colours: Bytes, guides: Bytes) -> Bytes:
    """Colours and guides as pixels of `goal.channels` bytes."""
    height, width = guides.shape[:2]
    out = np.zeros((height, width, goal.channels), np.uint8)
    out[..., : goal.colours] = colours
    out[..., goal.colours : goal.colours + guides.shape[2]] = guides
    return out


def padded(image: Bytes, margin: int) -> Bytes:
    """The image with its border repeated `margin` px around it, flat, and with a tail."""
    spread = ((margin, margin), (margin, margin)) + ((0, 0),) * (image.ndim - 2)
    return np.concatenate([np.pad(image, spread, "edge").reshape(-1), np.zeros(TAIL, np.uint8)])


def halved(image: NDArray[np.generic], nearest: bool = False) -> NDArray[np.generic]:
    """Half the size, rounded up: each pixel the mean of 2 x 2 (or the top left of them); the border is repeated.

    So pixel x of the coarse level is centred on 2 x + 0.5 of the fine one, whatever the size.
    """
    height, width = image.shape[:2]
    even = np.pad(image, ((0, height % 2), (0, width % 2)) + ((0, 0),) * (image.ndim - 2), "edge")
    if nearest:
        return np.ascontiguousarray(even[::2, ::2])
    if even.dtype == np.uint8:
        wide = even.astype(np.uint16)
        sums = wide[::2, ::2] + wide[::2, 1::2] + wide[1::2, ::2] + wide[1::2, 1::2]
        return np.asarray((sums + 2) >> 2, np.uint8)
    size = (even.shape[1] // 2, even.shape[0] // 2)
    return np.asarray(cv2.resize(even, size, interpolation=cv2.INTER_AREA))


def halvings(image: Bytes, levels: int) -> list[Bytes]:
    """The image at `levels` levels, finest first."""
    out = [image]
    for _ in range(levels - 1):
        out.append(np.asarray(halved(out[-1]), np.uint8))
    return out


def stacked(planes: Sequence[Bytes]) -> Bytes:
    """Planes and images one upon the other: (h, w, sum of channels)."""
    return np.ascontiguousarray(np.concatenate([p[..., None] if p.ndim == 2 else p for p in planes], axis=-1))
