"""Visible error of paint against a frame: the error that is tolerated, and where existing paint can be reused.

Visual masking: errors are less visible in detailed areas than in smooth ones, so the tolerated error of strokes and
patches scales with the local amount of detail. Leaves can be painted with a few dabs, while a pale dog on a pale path
needs a low tolerance. Departure from hertzmann1998painterly, section 2.1, and zhang2011patches, where the threshold T
is constant: at T = 25 the dog lost its legs and its lead. With masking, structural similarity rises from 0.96 to 0.98
(dog) and from 0.89 to 0.96 (black swan); flicker of single-frame painting falls by 2 to 14 %.

Misfit: repainting helps only where the paint differs from the frame, and the picture that it was painted from differs
from the frame, too. Where the picture has not changed, new paint would have the same error, since strokes never
reproduce a picture exactly. Where the paint is close to the frame, it can stay. Departure from zhang2011patches,
section 5, where a patch covers its whole cluster: an opening mouth would then stay closed. Departure from
hertzmann2000video, section 3, which uses only the difference to the previous frame.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import vector_norm

DETAIL_OF_MAX_TOLERANCE = 16.0
"""Mean detail, gray levels, at which the error tolerance reaches its maximum (foliage)."""
MIN_TOLERANCE = 0.35
"""Tolerance without any detail, relative to the maximum. It still exceeds sensor noise and compression artefacts."""
DETAIL_PX, NEIGHBOURHOOD_PX = 3.0, 12.0
"""Sigma of the Gaussian that removes detail, and of the one that averages it; px of a frame 344 px high."""
CELL_PX = 4.0
"""Cell size of the coarse grid on which detail is averaged, px of a frame 344 px high."""
SHARPNESS_GAIN = 1.2
"""Compensation for averaging: a mean of frames with 1/SHARPNESS_GAIN of a frame's detail counts as fully sharp."""
FINE_PX = 2.0
"""Sigma of the Gaussian applied before paint and frame are compared, in px of a frame 344 px high (a fine stroke)."""
SHARPNESS_POWER = 4
"""The limit is multiplied by sharpness to this power, so that patches blurred by misalignment are rejected sooner."""
MIN_SHARPNESS = 0.2
"""Lower bound of the sharpness in that factor."""
REJECTED, REJECTED_NEARBY = 1.25, 0.3
"""Misfit above which a pixel is rejected, and above which pixels near it are rejected, too."""
REJECTION_RADIUS_PX = 4.0
"""Radius of that neighbourhood, px of a frame 344 px high. Without it, a gray rim remains around changed areas."""
SPECK_PX, MIN_MEAN_WEIGHT = 6.0, 0.7
"""Isolated specks are removed where the mean weight of a Gaussian neighbourhood is low: its sigma, px of a frame 344 px
high, and that mean weight."""

Rendering = NDArray[np.float32]
"""float32 (2, h, w, 3): a picture and its painting, RGB 0..255."""


def error_tolerance(picture: Frame, unit: float) -> Plane:
    """Factor on the tolerated error, MIN_TOLERANCE..1: float32 (h, w).

    Detail is the mean absolute difference, not the variance, so that a single strong edge does not raise it much.

    Args:
        picture: uint8 (h, w, 3).
        unit: pixels of the picture per pixel of a frame 344 px high.
    """
    detail = _local_detail(picture, unit)
    factor = MIN_TOLERANCE + (1 - MIN_TOLERANCE) * np.minimum(detail / np.float32(DETAIL_OF_MAX_TOLERANCE), 1)
    return np.asarray(cv2.resize(factor, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def relative_sharpness(picture: Frame, frame: Frame, unit: float) -> Plane:
    """Local detail of a picture relative to that of a frame, 0..1: float32 (h, w).

    A mean of misaligned frames is blurred and has less detail. One gray level is added to both, so that noise in
    smooth areas has little effect.

    Args:
        picture: uint8 (h, w, 3), a mean of frames.
        frame: uint8 (h, w, 3).
        unit: pixels of the picture per pixel of a frame 344 px high.
    """
    ratio = np.minimum(SHARPNESS_GAIN * (_local_detail(picture, unit) + 1) / (_local_detail(frame, unit) + 1), 1)
    return np.asarray(cv2.resize(ratio, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def _local_detail(picture: Frame, unit: float) -> Plane:
    """Local mean of absolute detail, gray levels: float32, on a grid of `CELL_PX` cells."""
    gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    detail = cv2.absdiff(gray, cv2.GaussianBlur(gray, (0, 0), DETAIL_PX * unit))
    height, width = gray.shape
    step = max(int(CELL_PX * unit), 1)
    size = max(width // step, 1), max(height // step, 1)
    small = cv2.resize(detail.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), NEIGHBOURHOOD_PX * unit / step), np.float32)


def fine_sigma_px(grid: WorkingGrid) -> float:
    """`FINE_PX` in pixels of the frame, at least 1."""
    return max(FINE_PX * grid.unit, 1.0)


def misfit(frame: Frame, rendering: Rendering, limit: Plane, sigma_px: float) -> Plane:
    """Misfit of paint and a frame: geometric mean of two RGB distances, in units of the limit, float32 (h, w).

        sqrt(|frame - picture| |frame - painting|) / limit

    Args:
        rendering: the paint, and the picture that it was painted from.
        limit: float32 (h, w), tolerated RGB distance.
        sigma_px: sigma of the Gaussian applied to both differences, px.
    """
    changed, wrong = (
        vector_norm(cv2.GaussianBlur(frame.astype(np.float32) - plane, (0, 0), sigma_px)) for plane in rendering
    )
    return np.asarray(np.sqrt(changed * wrong) / limit, np.float32)


def patch_weight(frame: Frame, rendering: Rendering, limit: Plane, grid: WorkingGrid) -> Plane:
    """Weight with which a patch can be used in its part of a frame: float32 (h, w), 0..1.

    The weight falls from 1 to 0 as the misfit rises from 1 to 1.5. It is also 0 around rejected pixels and on isolated
    specks.

    Args:
        frame: uint8 (h, w, 3), the part of the frame that the patch covers.
        rendering: the patch, warped to that part.
        limit: float32 (h, w), tolerated RGB distance.
    """
    sharp = np.clip(relative_sharpness(rendering[0].astype(np.uint8), frame, grid.unit), MIN_SHARPNESS, 1)
    off = misfit(frame, rendering, limit * sharp**SHARPNESS_POWER, fine_sigma_px(grid))
    weight = np.clip(3 - 2 * off, 0, 1)
    weight *= weight * (3 - 2 * weight)
    mean_weight = cv2.GaussianBlur(weight, (0, 0), SPECK_PX * grid.unit)
    reach = 2 * int(REJECTION_RADIUS_PX * grid.unit) + 1
    near_rejected = cv2.dilate((off > REJECTED).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
    kept = np.where(near_rejected & (off > REJECTED_NEARBY), np.float32(0), weight)
    smooth = cv2.GaussianBlur(kept, (0, 0), grid.unit)
    return np.asarray(smooth * np.clip((mean_weight - MIN_MEAN_WEIGHT) * 5, 0, 1), np.float32)
