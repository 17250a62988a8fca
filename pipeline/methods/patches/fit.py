"""Whether paint still shows what is in a frame."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.methods.patches.links import norm

PAINT_W = 1.0
PICTURE_W = 1.0


def apart(
    frame: Frame, picture: NDArray[np.float32], paint: NDArray[np.float32], limit: Plane, sigma: float
) -> Plane:
    """How far paint is from showing the frame, in limits: sqrt(changed * wrong)."""
    whole = frame.astype(np.float32)
    changed = norm(cv2.GaussianBlur(whole - picture, (0, 0), sigma))
    wrong = norm(cv2.GaussianBlur(whole - paint, (0, 0), sigma))
    return np.asarray(np.sqrt(changed*PICTURE_W * wrong*PAINT_W) / limit, np.float32)
