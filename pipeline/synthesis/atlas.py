"""Atlas of several style images, stacked in columns with gaps wider than a patch at every pyramid level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.synthesis.images import NOWHERE, Bytes, Offsets

MAX_ROWS = 32000
"""Maximum height of a column of several images, px: rounded offsets are 16-bit integers."""


@dataclass(frozen=True)
class AtlasImage:
    """Position and size of an image in an atlas, and size of its cell, which includes the gap behind it, px."""

    left: int
    top: int
    width: int
    height: int
    cell: tuple[int, int]


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
        out = np.empty((self.size[1], self.size[0], *pictures[0].shape[2:]), pictures[0].dtype)
        for picture, image in zip(pictures, self.images, strict=True):
            margins = ((0, image.cell[1] - image.height), (0, image.cell[0] - image.width))
            cell = out[image.top : image.top + image.cell[1], image.left : image.left + image.cell[0]]
            cell[...] = np.pad(picture, (*margins, *((0, 0),) * (picture.ndim - 2)), "edge")
        return out

    def usable(self, masks: Sequence[Bytes | None]) -> Bytes:
        """1 at the pixels of images whose mask is not 0, otherwise 0, uint8 (h, w); mask None = the whole image."""
        out = np.zeros((self.size[1], self.size[0]), np.uint8)
        for image, mask in zip(self.images, masks, strict=True):
            box = out[image.top : image.top + image.height, image.left : image.left + image.width]
            box[...] = 1 if mask is None else mask > 0
        return out

    def identity(self, index: int, painted: Bytes | None) -> Offsets:
        """Offsets that reproduce image `index`; NOWHERE where `painted` is 0."""
        image = self.images[index]
        y, x = np.mgrid[: image.height, : image.width].astype(np.float32)
        offsets = np.stack([x + np.float32(image.left), y + np.float32(image.top)], -1)
        if painted is not None:
            offsets[painted == 0] = NOWHERE
        return np.ascontiguousarray(offsets)


def relocated(offsets: Offsets, before: Mapping[int, AtlasImage], now: Mapping[int, AtlasImage]) -> Offsets:
    """Convert offsets into one atlas to offsets into another; NOWHERE at pixels of images that it lacks.

    Args:
        before, now: images of both atlases by name.
    """
    if before == now:
        return offsets
    found, at = np.full_like(offsets, NOWHERE), np.rint(offsets)
    for name in before.keys() & now.keys():
        old, new = before[name], now[name]
        within = at - np.array((old.left, old.top), np.float32)
        inside = ((within >= 0) & (within < np.array((old.width, old.height)))).all(-1)
        found[inside] = offsets[inside] + np.array((new.left - old.left, new.top - old.top), np.float32)
    return found


def atlas(sizes: Sequence[tuple[int, int]], levels: int, gutter_px: int) -> Atlas:
    """Arrange images of these (width, height) in an atlas.

    Args:
        levels: number of levels of the pyramid.
        gutter_px: minimum distance of two images at the coarsest level, px.
    """
    unit = 1 << (levels - 1)

    def round_up(value: int) -> int:
        return -(-value // unit) * unit

    columns: list[list[tuple[int, int, int]]] = [[]]
    top = 0
    for width, height in sizes:
        if top + round_up(height) > MAX_ROWS and columns[-1]:
            columns.append([])
            top = 0
        columns[-1].append((top, width, height))
        top += round_up(height) + gutter_px * unit
    bottoms = [column[-1][0] + round_up(column[-1][2]) + gutter_px * unit for column in columns]
    images, left = list[AtlasImage](), 0
    for number, column in enumerate(columns):
        gap = gutter_px * unit if number + 1 < len(columns) else 0
        across = round_up(max(width for _, width, _ in column)) + gap
        ends = [place for place, *_ in column[1:]] + [max(bottoms)]
        images += [
            AtlasImage(left, place, width, height, (across, end - place))
            for (place, width, height), end in zip(column, ends, strict=True)
        ]
        left += across
    return Atlas(tuple(images), (left, max(bottoms)))


def downscaled_offsets(offsets: Offsets, levels: int) -> Offsets:
    """Downscale offsets by `levels` levels: each takes every second pixel of every second row and halves the values."""
    for _ in range(levels):
        sampled = offsets[::2, ::2]
        offsets = np.where(sampled > NOWHERE, (sampled - np.float32(0.5)) * np.float32(0.5), NOWHERE)
    return np.ascontiguousarray(offsets, np.float32)
