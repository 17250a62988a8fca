"""Compositing of pictures with opacity, mattes and blend modes, on stored sRGB values."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame

Blend = Literal["over", "multiply", "screen", "add"]


def lay_over(
    below: Frame, above: Frame, opacity: float = 1.0, blend: Blend = "over", matte: NDArray[np.uint8] | None = None
) -> Frame:
    """A picture laid over another, uint8 (height, width, 3), rounded to nearest.

    Args:
        opacity: 0..1.
        blend: "over" shows `above`; "multiply" darkens, "screen" lightens, "add" sums the values, up to 255.
        matte: uint8 (height, width): 255 where `above` is, 0 where it is not; None: it is everywhere.

    Returns:
        below + opacity * matte / 255 * (blended - below), where `blended` is (Porter and Duff 1984; W3C Compositing
        and Blending Level 1) above, above * below / 255, 255 - (255 - above) * (255 - below) / 255, above + below.
    """
    a, b, full = above.astype(np.float32), below.astype(np.float32), np.float32(255)
    blended = _blended(a, b, full, blend)
    share: np.float32 | NDArray[np.float32] = np.float32(opacity)
    if matte is not None:
        share = share * (matte.astype(np.float32) / full)[..., None]
    return np.asarray(np.rint(b + share * (blended - b)).clip(0, 255), np.uint8)


def _blended(a: NDArray[np.float32], b: NDArray[np.float32], full: np.float32, blend: Blend) -> NDArray[np.float32]:
    if blend == "multiply":
        return a * b / full
    if blend == "screen":
        return np.asarray(full - (full - a) * (full - b) / full, np.float32)
    return np.minimum(a + b, full) if blend == "add" else a


def covers(opacity: float, blend: Blend, matted: bool) -> bool:
    """Whether a layer hides everything below it."""
    return opacity >= 1 and blend == "over" and not matted
