"""Several style images as one: one below the other, so far apart that no patch sees two, at sizes that halve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.synthesis.images import NOWHERE, Bytes, Offsets


@dataclass(frozen=True)
class Place:
    """Where an image lies in an atlas: px from its top, and its size."""

    top: int
    width: int
    height: int


@dataclass(frozen=True)
class Atlas:
    """Where images lie.

    Attributes:
        size: (width, height) of the whole, multiples of 2^(levels - 1).
    """

    places: tuple[Place, ...]
    size: tuple[int, int]

    def lay(self, images: Sequence[NDArray[np.generic]]) -> NDArray[np.generic]:
        """The images in their places; what lies between repeats the border of the nearest."""
        ends = [place.top for place in self.places[1:]] + [self.size[1]]
        parts = []
        for image, place, end in zip(images, self.places, ends, strict=True):
            grow = ((0, end - place.top - place.height), (0, self.size[0] - place.width))
            parts.append(np.pad(image, (*grow, *((0, 0),) * (image.ndim - 2)), "edge"))
        return np.ascontiguousarray(np.concatenate(parts))

    def usable(self, masks: Sequence[Bytes | None]) -> Bytes:
        """1 where an image lies (and its mask is not 0), uint8 (h, w)."""
        out = np.zeros((self.size[1], self.size[0]), np.uint8)
        for place, mask in zip(self.places, masks, strict=True):
            box = out[place.top : place.top + place.height, : place.width]
            box[...] = 1 if mask is None else mask > 0
        return out

    def identity(self, index: int, painted: Bytes | None) -> Offsets:
        """Offsets that show image `index` as it is, NOWHERE where its mask is 0."""
        place = self.places[index]
        y, x = np.mgrid[: place.height, : place.width].astype(np.float32)
        found = np.stack([x, y + np.float32(place.top)], -1)
        if painted is not None:
            found[painted == 0] = NOWHERE
        return np.ascontiguousarray(found)


def atlas(sizes: Sequence[tuple[int, int]], levels: int, gutter_px: int) -> Atlas:
    """Places for images of these (width, height), at least `gutter_px` apart at the coarsest of `levels` levels."""
    unit = 1 << (levels - 1)

    def up(value: int) -> int:
        return -(-value // unit) * unit

    places, top = [], 0
    for width, height in sizes:
        places.append(Place(top, width, height))
        top += up(height) + gutter_px * unit
    return Atlas(tuple(places), (up(max(width for width, _ in sizes)), top))


def coarser(offsets: Offsets, levels: int) -> Offsets:
    """Offsets of the finest level as those of a level `levels` up: every second pixel of every second row, halved."""
    for _ in range(levels):
        kept = offsets[::2, ::2]
        offsets = np.where(kept > NOWHERE, (kept - np.float32(0.5)) * np.float32(0.5), NOWHERE)
    return np.ascontiguousarray(offsets, np.float32)
