"""Atlas of several style images, stacked vertically with gaps wider than a patch at every pyramid level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.synthesis.images import NOWHERE, Bytes, Offsets


@dataclass(frozen=True)
class AtlasImage:
    """Position (rows from the top) and size of an image in an atlas, px."""

    top: int
    width: int
    height: int


@dataclass(frozen=True)
class Atlas:
    """Layout of an atlas.

    Attributes:
        images: position and size of each image.
        size: (width, height) of the atlas, px, multiples of 2^(levels - 1).
    """

    images: tuple[AtlasImage, ...]
    size: tuple[int, int]

    def compose(self, pictures: Sequence[NDArray[np.generic]]) -> NDArray[np.generic]:
        """Compose the atlas from the pictures; gaps repeat the border of the picture above or to the left."""
        ends = [image.top for image in self.images[1:]] + [self.size[1]]
        parts = []
        for picture, image, end in zip(pictures, self.images, ends, strict=True):
            margins = ((0, end - image.top - image.height), (0, self.size[0] - image.width))
            parts.append(np.pad(picture, (*margins, *((0, 0),) * (picture.ndim - 2)), "edge"))
        return np.ascontiguousarray(np.concatenate(parts))

    def usable(self, masks: Sequence[Bytes | None]) -> Bytes:
        """1 at the pixels of images whose mask is not 0, otherwise 0, uint8 (h, w); mask None = the whole image."""
        out = np.zeros((self.size[1], self.size[0]), np.uint8)
        for image, mask in zip(self.images, masks, strict=True):
            box = out[image.top : image.top + image.height, : image.width]
            box[...] = 1 if mask is None else mask > 0
        return out

    def identity(self, index: int, painted: Bytes | None) -> Offsets:
        """Offsets that reproduce image `index`; NOWHERE where `painted` is 0."""
        image = self.images[index]
        y, x = np.mgrid[: image.height, : image.width].astype(np.float32)
        offsets = np.stack([x, y + np.float32(image.top)], -1)
        if painted is not None:
            offsets[painted == 0] = NOWHERE
        return np.ascontiguousarray(offsets)


def atlas(sizes: Sequence[tuple[int, int]], levels: int, gutter_px: int) -> Atlas:
    """Arrange images of these (width, height) in an atlas.

    Args:
        levels: number of levels of the pyramid.
        gutter_px: minimum distance of two images at the coarsest level, px.
    """
    unit = 1 << (levels - 1)

    def round_up(value: int) -> int:
        return -(-value // unit) * unit

    images, top = [], 0
    for width, height in sizes:
        images.append(AtlasImage(top, width, height))
        top += round_up(height) + gutter_px * unit
    return Atlas(tuple(images), (round_up(max(width for width, _ in sizes)), top))


def downscaled_offsets(offsets: Offsets, levels: int) -> Offsets:
    """Downscale offsets by `levels` levels: each takes every second pixel of every second row and halves the values."""
    for _ in range(levels):
        sampled = offsets[::2, ::2]
        offsets = np.where(sampled > NOWHERE, (sampled - np.float32(0.5)) * np.float32(0.5), NOWHERE)
    return np.ascontiguousarray(offsets, np.float32)
