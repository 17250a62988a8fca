"""How transparent paint dries on paper: where it leaves rims, and where its grain settles. Both go with the motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.abstraction.state import State
from pipeline.strokes.granulation import Slips, carry_slips

RIM, RIM_DEPTH = 0.008, 22.0
"""Width of the rim at which paint dries, in heights; and the step, gray levels, that makes a full one."""
FOLLOW = 0.25
"""How far a rim goes towards what the picture says in a frame: what has dried does not run."""


class Drying:
    """Of one stream of frames.

    Args:
        paper: whether there is any.
    """

    def __init__(self, paper: bool) -> None:
        self.paper = paper
        self.rims: Plane | None = None
        self.slips: Slips | None = None

    def step(
        self, picture: Frame, back: Flow | None, other: Mask | None, coarse: NDArray[np.float16] | None, number: int,
        rows: int,
    ) -> tuple[NDArray[np.uint8] | None, NDArray[np.float16] | None]:  # fmt: skip
        """Rims and slips of frame `number`, as `Sight` has them.

        Args:
            picture: uint8 (h, w, 3), the held picture.
            back: float32 (h, w, 2), from this frame to the one before; None = a shot begins.
            other: bool (h, w), where it shows something else than before.
            coarse: float16, `back` at the size that slips have, in px of the picture.
            rows: of the frame.
        """
        if not self.paper:
            return None, None
        if back is None or coarse is None:
            self.rims = self.slips = None
        now = _rims(picture)
        if back is not None and self.rims is not None and other is not None:
            past = fetch(self.rims, back)
            now = np.asarray(past + np.where(other, np.float32(1), np.float32(FOLLOW)) * (now - past), np.float32)
        self.rims = now
        rims = np.asarray(np.rint(now * 255), np.uint8)
        if coarse is None:
            return rims, None
        way = coarse.astype(np.float32) * np.float32(coarse.shape[0] / picture.shape[0])
        self.slips = carry_slips(self.slips, way, number, rows / coarse.shape[0])
        return rims, self.slips.astype(np.float16)

    def state(self) -> State:
        return {name: array for name, array in (("rims", self.rims), ("slips", self.slips)) if array is not None}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.rims, self.slips = state.get("rims"), state.get("slips")


def _rims(picture: Frame) -> Plane:
    """Where wet paint has run to the edge of its area and dried, 0..1: the darker side of a border."""
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    wide = RIM * gray.shape[0]
    lack = cv2.GaussianBlur(gray, (0, 0), wide) - cv2.GaussianBlur(gray, (0, 0), max(wide / 3, 0.5))
    return np.asarray(np.clip(lack * np.float32(1 / RIM_DEPTH), 0, 1), np.float32)
