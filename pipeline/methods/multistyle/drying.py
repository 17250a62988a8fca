"""How transparent paint dries on paper: where it leaves rims, which go with the motion and do not run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.abstraction.state import State

RIM, RIM_DEPTH = 0.008, 22.0
"""Width of the rim at which paint dries, in heights; and the step, gray levels, that makes a full one."""
FOLLOW = 0.15
"""How far a rim goes towards what the picture says in a frame: what has dried does not run."""


class Drying:
    """Of one stream of frames.

    Args:
        paper: whether there is any.
    """

    def __init__(self, paper: bool) -> None:
        self.paper = paper
        self.rims: Plane | None = None

    def step(self, picture: Frame, back: Flow | None, other: Mask | None) -> NDArray[np.uint8] | None:
        """The next frame's rims, as `Sight` has them; None: there is no paper.

        Args:
            picture: uint8 (h, w, 3), the held picture.
            back: float32 (h, w, 2), from this frame to the one before; None = a shot begins.
            other: bool (h, w), where it shows something else than before.
        """
        if not self.paper:
            return None
        now = _rims(picture)
        if back is not None and self.rims is not None and other is not None:
            past = fetch(self.rims, back)
            now = np.asarray(past + np.where(other, np.float32(1), np.float32(FOLLOW)) * (now - past), np.float32)
        self.rims = now
        return np.asarray(np.rint(now * 255), np.uint8)

    def state(self) -> State:
        return {} if self.rims is None else {"rims": self.rims}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.rims = state.get("rims")


def _rims(picture: Frame) -> Plane:
    """Where wet paint has run to the edge of its area and dried, 0..1: the darker side of a border."""
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    wide = RIM * gray.shape[0]
    lack = cv2.GaussianBlur(gray, (0, 0), wide) - cv2.GaussianBlur(gray, (0, 0), max(wide / 3, 0.5))
    return np.asarray(np.clip(lack * np.float32(1 / RIM_DEPTH), 0, 1), np.float32)
