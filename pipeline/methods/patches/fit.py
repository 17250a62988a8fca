"""Whether paint still shows what is in a frame.

    paint, and the picture that it was made from      wrong    how far the paint is from the frame
                                                      changed  how far the picture is from it

Only where both are large does new paint help: paint that was never near enough (strokes are not pixels) would be no
nearer if it were painted again, and where the picture has changed but the paint will do there is no need to.

Departure from zhang2011patches, section 5, where a patch covers all of its cluster: a mouth that opens is then never
seen. Departure from hertzmann2000video, section 3, which looks at the difference to the frame before only.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.links import norm
from pipeline.methods.patches.masking import sharpness

FINE_PX = 2.0
"""Sigma of the Gaussian at which paint is compared with a frame, px of the paper's frames: of a fine stroke."""
BLURRED = 4
"""Power of a patch's sharpness by which it is let pass less: a mean of what did not hold still is soon given up."""
MOST_BLURRED = 0.2
CORE, RIM = 1.25, 0.3
"""Misfits from which a place is lost, and from which what is around it goes with it."""
RIM_PX = 4.0
"""How far around, px of the paper's frames: else a dark thing leaves a gray rim of what covered it."""
SPECKLED_PX, SPECKLED = 6.0, 0.7
"""Sigma of the surroundings, same px, and the part of them that has to fit: a patch of specks is no patch."""

Look = NDArray[np.float32]
"""float32 (2, h, w, 3): a picture, and how it is painted."""


def fine_px(grid: Grid) -> float:
    """FINE_PX in px, at least 1."""
    return max(FINE_PX * grid.unit, 1.0)


def apart(frame: Frame, look: Look, limit: Plane, sigma_px: float) -> Plane:
    """How little paint shows a frame, in limits: sqrt(changed * wrong), float32 (h, w).

    Args:
        limit: float32 (h, w), RGB distance that is let pass.
        sigma_px: of the Gaussian at which they are compared, px.
    """
    changed, wrong = (norm(cv2.GaussianBlur(frame.astype(np.float32) - plane, (0, 0), sigma_px)) for plane in look)
    return np.asarray(np.sqrt(changed * wrong) / limit, np.float32)


def patch_fits(frame: Frame, look: Look, limit: Plane, grid: Grid) -> Plane:
    """How well a patch shows what is in its part of a frame, 0..1: float32 (h, w).

    It falls from one limit to one and a half; what is around a lost place is lost, and what is left of specks.
    """
    sharp = np.clip(sharpness(look[0].astype(np.uint8), frame, grid.unit), MOST_BLURRED, 1)
    off = apart(frame, look, limit * sharp**BLURRED, fine_px(grid))
    keep = np.clip(3 - 2 * off, 0, 1)
    keep *= keep * (3 - 2 * keep)
    around = cv2.GaussianBlur(keep, (0, 0), SPECKLED_PX * grid.unit)
    reach = 2 * int(RIM_PX * grid.unit) + 1
    lost = cv2.dilate((off > CORE).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
    firm = cv2.GaussianBlur(np.where(lost & (off > RIM), np.float32(0), keep), (0, 0), grid.unit)
    return np.asarray(firm * np.clip((around - SPECKLED) * 5, 0, 1), np.float32)
