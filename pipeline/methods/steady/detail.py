"""Restoration of fine detail that averaging along the motion has blurred."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.frames import Plane
from pipeline.jit import kernel
from pipeline.methods.steady.confidence import Picture

SIGMA_PX = 1.0
"""Standard deviation of the Gaussian blur whose complement is fine detail."""
WINDOW_PX = 17
"""Window over which the amounts of detail are compared."""
LARGEST = 3.0
"""Largest fraction of missing detail that counts: faint texture does not become noise."""


def restore_detail(picture: Picture, styled: Picture, share: float) -> Picture:
    """`picture` with its own fine detail amplified, up to the amount that `styled` has around each pixel.

    Args:
        picture, styled: float32 (h, w, 3), 0..255.
        share: of the missing detail that is restored, 0..1.
    """
    out = picture.copy()
    fine, wished = _fine(picture), _fine(styled)
    have, want = (cv2.blur(_amount(part), (WINDOW_PX, WINDOW_PX)) for part in (fine, wished))
    _amplify(out, fine, have, want, np.float32(share))
    return out


def _fine(picture: Picture) -> Picture:
    return np.asarray(picture - cv2.GaussianBlur(picture, (0, 0), SIGMA_PX), np.float32)


def _amount(part: Picture) -> Plane:
    """Sum of the channels' absolute values."""
    return np.abs(part) @ np.ones(3, np.float32)


@kernel
def _amplify(picture: Any, fine: Any, have: Any, want: Any, share: Any) -> None:
    height, width, _ = picture.shape
    for y in range(height):
        for x in range(width):
            missing = want[y, x] / (have[y, x] + np.float32(1e-3)) - np.float32(1)
            gain = share * min(max(missing, np.float32(0)), np.float32(LARGEST))
            for c in range(3):
                picture[y, x, c] += gain * fine[y, x, c]
