"""Images of the synthesis: style and target at one pyramid level, and their packed byte layout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.synthesis.energy import Energy

Bytes: TypeAlias = NDArray[np.uint8]
Offsets: TypeAlias = NDArray[np.float32]
"""Position (x, y) in the style for each pixel, px, float32 (h, w, 2); x <= NOWHERE = no position."""
NOWHERE = np.float32(-1e6)
TAIL = 64
"""Padding bytes after an image, because the last vector load of the last patch reads beyond the image."""


@dataclass(frozen=True)
class StyleImage:
    """A style image, or an atlas of several, at one level.

    Attributes:
        colours: style output S^, whose colours form the result: uint8 (h, w, 3), or (h, w, 4) with straight alpha.
        features: S^ in the colour space of the patch comparison, then the guides of S, then zeros; uint8
            (h, w, channels).
        bins: direction of each pixel, uint8 (h, w); None = patches are not rotated.
        usable: uint8 (h, w), 0 = the pixel must not be used; None = all pixels may be used.
        distance: float32 (h, w), distance to the nearest line of the style, px; None = no lines.
    """

    colours: Bytes
    features: Bytes
    bins: Bytes | None = None
    usable: Bytes | None = None
    distance: Plane | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), px."""
        return self.colours.shape[1], self.colours.shape[0]

    @property
    def first_usable(self) -> tuple[int, int]:
        """Position (x, y) of the first usable pixel."""
        if self.usable is None:
            return 0, 0
        y, x = np.unravel_index(int(self.usable.argmax()), self.usable.shape)
        return int(x), int(y)


@dataclass(frozen=True)
class Target:
    """A frame at one level.

    Attributes:
        guides: guides of the input I, uint8 (h, w, guide channels).
        bins: direction of each pixel, uint8 (h, w); None = patches are not rotated.
        distance: float32 (h, w), distance to the nearest line, px; None = no lines.
    """

    guides: Bytes
    bins: Bytes | None = None
    distance: Plane | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), px."""
        return self.guides.shape[1], self.guides.shape[0]


def packed(energy: Energy, colours: Bytes, guides: Bytes) -> Bytes:
    """Pack colours and guides into pixels of `energy.channels` bytes."""
    used = energy.colours + guides.shape[2]
    out = np.zeros((*guides.shape[:2], energy.channels), np.uint8)
    # cv2.mixChannels is four times as fast as assigning slices of the last axis.
    pairs = [channel for pair in zip(range(used), range(used), strict=True) for channel in pair]
    cv2.mixChannels([np.ascontiguousarray(colours), np.ascontiguousarray(guides)], [out], pairs)
    return out


def padded(image: Bytes, margin: int) -> Bytes:
    """Pad an image by `margin` px of its repeated border; returns it flattened and followed by `TAIL` bytes."""
    spread = ((margin, margin), (margin, margin)) + ((0, 0),) * (image.ndim - 2)
    return np.concatenate([np.pad(image, spread, "edge").reshape(-1), np.zeros(TAIL, np.uint8)])


def halved(image: NDArray[np.generic], nearest: bool = False) -> NDArray[np.generic]:
    """Halve an image, rounding the size up: each pixel is the mean of 2x2 pixels, or the top left one if `nearest`.

    The border is repeated for odd sizes, so that pixel x of the coarse level is always centred on 2 x + 0.5 of the fine
    level.
    """
    height, width = image.shape[:2]
    even = np.pad(image, ((0, height % 2), (0, width % 2)) + ((0, 0),) * (image.ndim - 2), "edge")
    if nearest:
        return np.ascontiguousarray(even[::2, ::2])
    if even.dtype == np.uint8:
        rows = np.add(even[::2], even[1::2], dtype=np.uint16)
        sums = rows[:, ::2] + rows[:, 1::2]
        sums += 2
        sums >>= 2
        return sums.astype(np.uint8)
    size = (even.shape[1] // 2, even.shape[0] // 2)
    return np.asarray(cv2.resize(even, size, interpolation=cv2.INTER_AREA))


def stacked(planes: Sequence[Bytes]) -> Bytes:
    """Concatenate planes and images along the channel axis: (h, w, sum of channels)."""
    return np.ascontiguousarray(np.concatenate([p[..., None] if p.ndim == 2 else p for p in planes], axis=-1))


_NO_OFFSET = 65535


def _fraction(longest_px: int) -> int:
    """Number of sub-pixel steps with which offsets into the style fit into 16 bits: a power of two, at most 16."""
    steps = 16
    while steps > 1 and (longest_px + 1) * steps >= _NO_OFFSET:
        steps //= 2
    return steps


def pack_offsets(offsets: Offsets, longest_px: int) -> NDArray[np.uint16]:
    """Quantise offsets to uint16 (h, w, 2) for storage: steps of 1/16 px for styles of up to 4094 px."""
    steps = np.float32(_fraction(longest_px))
    whole = np.clip(np.rint(offsets * steps) + steps, 0, _NO_OFFSET - 1).astype(np.uint16)
    return np.where(offsets > NOWHERE, whole, np.uint16(_NO_OFFSET))


def unpack_offsets(packed_offsets: NDArray[np.uint16], longest_px: int) -> Offsets:
    """The inverse of `pack_offsets`: float32 (h, w, 2), NOWHERE where there was no offset."""
    steps = np.float32(_fraction(longest_px))
    found = (packed_offsets.astype(np.float32) - steps) / steps
    return np.where(packed_offsets == _NO_OFFSET, NOWHERE, found).astype(np.float32)
