"""Where on the sheet each pixel's grain is: pigment that has settled goes with what it paints, and does not shimmer.

A sheet that stays where it is while things move behind it looks like a dirty window. So the grain is carried along the
motion, in two phases that begin anew in turn: each is stretched by no more motion than that of a period, and neither is
seen when it begins. Where nothing moves both lie on the sheet as it is.

Source: bousseau2007video, section 4 (bidirectional texture advection). Departure: forwards only, since frames come one
by one; and the mix keeps the contrast that two sheets have which have nothing in common.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.flow.warp import fetch
from pipeline.frames import Flow

PERIOD = 32
"""Frames that a phase lasts."""

Slips = NDArray[np.float32]
"""float32 (h, w, 4): how far from each pixel its grain is on the sheet, (x, y) of either phase, px of the frame."""


def shares_of(number: int) -> tuple[float, float]:
    """How much each phase shows in frame `number`, 0..1; together they are 1, and a phase that begins anew has 0."""
    one = 1 - abs(2 * (number % PERIOD) / PERIOD - 1)
    return one, 1 - one


def carry_slips(before: Slips | None, back: Flow, number: int, scale: float) -> Slips:
    """Those of frame `number`.

    Args:
        before: those of the frame before; None = the sheet as it is.
        back: from the frame to the one before, float32 (h, w, 2), of the slips' size and in its px.
        scale: px of the frame in one px of `back`.
    """
    slips = np.concatenate([back, back], axis=2) * np.float32(scale)
    if before is not None:
        slips += fetch(before, back)
    for phase in range(2):
        if (number + phase * PERIOD // 2) % PERIOD == 0:
            slips[..., 2 * phase : 2 * phase + 2] = 0
    return np.asarray(slips, np.float32)
