"""Atlas of several style images, stacked vertically with gaps wider than a patch at every pyramid level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.synthesis.images import NOWHERE, Bytes, Offsets


@dataclass(frozen=True)
class Place:
    """Position (rows from the top) and size of an image in an atlas, px."""

    top: int
    width: int
    height: int


@dataclass(frozen=True)
class Atlas:
    """Layout of an atlas.

    Attributes:
        places: position and size of each image.
        size: (width, height) of the atlas, px, multiples of 2^(levels - 1).
    """

    places: tuple[Place, ...]
    size: tuple[int, int]

    def lay(self, images: Sequence[NDArray[np.generic]]) -> NDArray[np.generic]:
        """Compose the atlas from the images; gaps repeat the border of the image above or to the left."""
        ends = [place.top for place in self.places[1:]] + [self.size[1]]
        parts = []
        for image, place, end in zip(images, self.places, ends, strict=True):
            grow = ((0, end - place.top - place.height), (0, self.size[0] - place.width))
            parts.append(np.pad(image, (*grow, *((0, 0),) * (image.ndim - 2)), "edge"))
        return np.ascontiguousarray(np.concatenate(parts))

    def usable(self, masks: Sequence[Bytes | None]) -> Bytes:
        """1 at the pixels of images whose mask is not 0, otherwise 0, uint8 (h, w); mask None = the whole image."""
        out = np.zeros((self.size[1], self.size[0]), np.uint8)
        for place, mask in zip(self.places, masks, strict=True):
            box = out[place.top : place.top + place.height, : place.width]
            box[...] = 1 if mask is None else mask > 0
        return out

    def identity(self, index: int, painted: Bytes | None) -> Offsets:
        """Offsets that reproduce image `index`; NOWHERE where `painted` is 0."""
        place = self.places[index]
        y, x = np.mgrid[: place.height, : place.width].astype(np.float32)
        found = np.stack([x, y + np.float32(place.top)], -1)
        if painted is not None:
            found[painted == 0] = NOWHERE
        return np.ascontiguousarray(found)


def atlas(sizes: Sequence[tuple[int, int]], levels: int, gutter_px: int) -> Atlas:
    """Lay out images of the given (width, height), at least `gutter_px` apart at the coarsest of `levels` levels."""
    unit = 1 << (levels - 1)

    def up(value: int) -> int:
        return -(-value // unit) * unit

    places, top = [], 0
    for width, height in sizes:
        places.append(Place(top, width, height))
        top += up(height) + gutter_px * unit
    return Atlas(tuple(places), (up(max(width for width, _ in sizes)), top))


def downscaled_offsets(offsets: Offsets, levels: int) -> Offsets:
    """Downscale offsets by `levels` levels: each takes every second pixel of every second row and halves the values."""
    for _ in range(levels):
        kept = offsets[::2, ::2]
        offsets = np.where(kept > NOWHERE, (kept - np.float32(0.5)) * np.float32(0.5), NOWHERE)
    return np.ascontiguousarray(offsets, np.float32)
