"""Painted keyframes: read and checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadInput
from pipeline.synthesis.images import Bytes

OPAQUE = 128
"""A pixel counts as painted from this opacity on (8 bit)."""


@dataclass(frozen=True)
class Keyframe:
    """A painted frame of the video."""

    index: int
    colours: Bytes
    """uint8 (h, w, 3), or (h, w, 4) with opacity for a keyframe of a layer."""
    painted: Bytes | None
    """uint8 (h, w), 0 = not painted; None = painted everywhere."""

    @property
    def full(self) -> bool:
        return self.painted is None


def read_keyframe(
    index: int, image: NDArray[Any], size: tuple[int, int], mask: NDArray[Any] | None, field: str
) -> Keyframe:
    """Check and convert a keyframe: 8 or 16 bit, gray, RGB or RGBA. Alpha, or `mask`, marks the painted pixels.

    Raises:
        BadInput: the size differs from the video's, or no pixel is painted.
    """
    if (image.shape[1], image.shape[0]) != size:
        raise BadInput(
            f"Keyframe {index} does not have the size of the video.", field=field,
            value=f"{image.shape[1]}x{image.shape[0]}",
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
            f"Keyframe {index} has no painted pixel: it is completely transparent.", field=field,
            remedy="Paint on it, or remove it.",
        )  # fmt: skip
    return Keyframe(index, np.ascontiguousarray(colours), painted)


def eight_bit(image: NDArray[Any]) -> Bytes:
    """Convert 16 bits a channel to 8; 8-bit images are returned unchanged."""
    return np.asarray(image if image.dtype == np.uint8 else image >> 8, np.uint8)


def _mask(index: int, mask: NDArray[Any], size: tuple[int, int]) -> Bytes:
    if (mask.shape[1], mask.shape[0]) != size:
        raise BadInput(
            f"Mask {index} does not have the size of the video.", field="inputs.masks",
            value=f"{mask.shape[1]}x{mask.shape[0]}", remedy=f"Make it {size[0]}x{size[1]}.",
        )  # fmt: skip
    eight = eight_bit(mask)
    return eight if eight.ndim == 2 else np.ascontiguousarray(eight[..., 0])
