"""Painted keyframes: read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadInput
from pipeline.synthesis.images import Bytes

if TYPE_CHECKING:
    from pipeline.methods.analogy.sources import Source

OPAQUE = 128
"""From this opacity on a pixel is painted (8 bit)."""


@dataclass(frozen=True)
class Key:
    """A painted frame."""

    index: int
    colours: Bytes
    """uint8 (h, w, 3), or (h, w, 4) with opacity: the key of a layer."""
    painted: Bytes | None
    """uint8 (h, w), 0 where it is not painted; None = painted all over."""

    @property
    def full(self) -> bool:
        return self.painted is None


def read_key(index: int, image: NDArray[Any], size: tuple[int, int], mask: NDArray[Any] | None, field: str) -> Key:
    """A keyframe of 8 or 16 bit, gray, RGB or RGBA; alpha, or a mask, says where it is painted.

    Raises:
        BadInput: it has not the frames' size, or nothing is painted.
    """
    if (image.shape[1], image.shape[0]) != size:
        raise BadInput(
            f"Keyframe {index} is not of the video's size.", field=field, value=f"{image.shape[1]}x{image.shape[0]}",
            remedy=f"Paint over frame {index} at {size[0]}x{size[1]}.",
        )  # fmt: skip
    eight = eight_bit(image)
    colours = np.repeat(eight[..., None], 3, axis=2) if eight.ndim == 2 else eight[..., :3]
    alpha = eight[..., 3] if eight.ndim == 3 and eight.shape[2] == 4 else None
    if mask is not None:
        alpha = _mask(index, mask, size)
    painted = None if alpha is None or (alpha >= OPAQUE).all() else (alpha >= OPAQUE).astype(np.uint8)
    if painted is not None and not painted.any():
        raise BadInput(
            f"Nothing is painted on keyframe {index}: it is transparent all over.", field=field,
            remedy="Paint on it, or leave it out.",
        )  # fmt: skip
    return Key(index, np.ascontiguousarray(colours), painted)


def eight_bit(image: NDArray[Any]) -> Bytes:
    """16 bit as 8 bit."""
    return np.asarray(image if image.dtype == np.uint8 else image >> 8, np.uint8)


def _mask(index: int, mask: NDArray[Any], size: tuple[int, int]) -> Bytes:
    if (mask.shape[1], mask.shape[0]) != size:
        raise BadInput(
            f"Mask {index} is not of the video's size.", field="inputs.masks",
            value=f"{mask.shape[1]}x{mask.shape[0]}", remedy=f"Make it {size[0]}x{size[1]}.",
        )  # fmt: skip
    eight = eight_bit(mask)
    return eight if eight.ndim == 2 else np.ascontiguousarray(eight[..., 0])


def key_numbers(source: Source, frames: int) -> list[tuple[int, bool]]:
    """(frame, painted all over) of each keyframe of a source.

    Raises:
        BadInput: a keyframe of a frame that there is not, one of another size, an empty one.
    """
    found = []
    for index in source.key_frames():
        if index >= frames:
            raise BadInput(
                f"There is a keyframe {index}, but no such frame.", field="inputs.keyframes", value=index,
                remedy=f"Name keyframes by frame numbers, 0 to {frames - 1}.",
            )  # fmt: skip
        found.append((index, source.key(index).full))
    return found
