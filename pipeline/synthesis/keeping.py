"""Offset fields as they are stored between tasks: whole numbers, four bytes a pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.synthesis.images import NOWHERE, Offsets

_NONE = 65535


def _fraction(longest_px: int) -> int:
    """Steps a pixel that a 16 bit number has left for the longest side, a power of two."""
    steps = 16
    while steps > 1 and (longest_px + 1) * steps >= _NONE:
        steps //= 2
    return steps


def kept(offsets: Offsets, longest_px: int) -> NDArray[np.uint16]:
    """Offsets as uint16, (h, w, 2): to a sixteenth of a pixel for styles up to 4094 px."""
    steps = np.float32(_fraction(longest_px))
    whole = np.clip(np.rint(offsets * steps) + steps, 0, _NONE - 1).astype(np.uint16)
    return np.where(offsets > NOWHERE, whole, np.uint16(_NONE))


def restored(whole: NDArray[np.uint16], longest_px: int) -> Offsets:
    """What `kept` has stored."""
    steps = np.float32(_fraction(longest_px))
    found = (whole.astype(np.float32) - steps) / steps
    return np.where(whole == _NONE, NOWHERE, found).astype(np.float32)
