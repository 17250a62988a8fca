"""Comparison of existing paint with a frame: decides where paint can be reused.

    wrong     distance between the paint and the frame
    changed   distance between the picture that the paint was made from and the frame

Repainting helps only where both are large. Where the picture has not changed, new paint would have the same error,
since strokes never reproduce a picture exactly. Where the paint is close to the frame, it can stay.

Departure from zhang2011patches, section 5, where a patch covers its whole cluster: an opening mouth would then stay
closed. Departure from hertzmann2000video, section 3, which uses only the difference to the previous frame.
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
"""Sigma of the Gaussian applied before paint and frame are compared, in px of a frame 344 px high (a fine stroke)."""
BLURRED = 4
"""The limit is multiplied by sharpness to this power, so that patches blurred by misalignment are rejected sooner."""
MOST_BLURRED = 0.2
"""Lower bound of the sharpness in that factor."""
CORE, RIM = 1.25, 0.3
"""Misfit, in units of the limit, above which a pixel is rejected, and above which pixels near it are rejected too."""
RIM_PX = 4.0
"""Radius of that neighbourhood, px of a frame 344 px high. Without it, a gray rim remains around uncovered areas."""
SPECKLED_PX, SPECKLED = 6.0, 0.7
"""Sigma of the neighbourhood, px of a frame 344 px high, and the mean fit below which isolated specks are removed."""

Rendering = NDArray[np.float32]
"""float32 (2, h, w, 3): a picture and its painting, RGB 0..255."""


def fine_px(grid: Grid) -> float:
    """`FINE_PX` in pixels of the frame, at least 1."""
    return max(FINE_PX * grid.unit, 1.0)


def apart(frame: Frame, rendering: Rendering, limit: Plane, sigma_px: float) -> Plane:
    """Misfit between paint and a frame in units of the limit: sqrt(changed * wrong) / limit, float32 (h, w).

    Args:
        limit: float32 (h, w), tolerated RGB distance.
        sigma_px: sigma of the Gaussian applied to both differences, px.
    """
    changed, wrong = (norm(cv2.GaussianBlur(frame.astype(np.float32) - plane, (0, 0), sigma_px)) for plane in rendering)
    return np.asarray(np.sqrt(changed * wrong) / limit, np.float32)


def patch_fits(frame: Frame, rendering: Rendering, limit: Plane, grid: Grid) -> Plane:
    """Weight with which a patch can be used in its part of a frame: float32 (h, w), 0..1.

    The weight falls from 1 to 0 as the misfit rises from 1 to 1.5 limits. It is also 0 around rejected pixels and on
    isolated specks.
    """
    sharp = np.clip(sharpness(rendering[0].astype(np.uint8), frame, grid.unit), MOST_BLURRED, 1)
    off = apart(frame, rendering, limit * sharp**BLURRED, fine_px(grid))
    keep = np.clip(3 - 2 * off, 0, 1)
    keep *= keep * (3 - 2 * keep)
    around = cv2.GaussianBlur(keep, (0, 0), SPECKLED_PX * grid.unit)
    reach = 2 * int(RIM_PX * grid.unit) + 1
    lost = cv2.dilate((off > CORE).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
    firm = cv2.GaussianBlur(np.where(lost & (off > RIM), np.float32(0), keep), (0, 0), grid.unit)
    return np.asarray(firm * np.clip((around - SPECKLED) * 5, 0, 1), np.float32)
