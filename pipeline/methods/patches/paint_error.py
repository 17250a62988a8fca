"""Visible error of paint against a frame: the tolerated error, and the places where existing paint can be reused.

Visual masking: errors are less visible in detailed areas than in smooth ones, so the tolerated error of strokes and
patches scales with the local amount of detail. Leaves can be painted with a few dabs, while a pale dog on a pale path
needs a low tolerance. Departure from hertzmann1998painterly, section 2.1, and zhang2011patches, where the threshold T
is constant: at T = 25 the dog would lose its legs and its lead.

Misfit: repainting helps only where the paint differs from the frame, and the picture that it was painted from differs
from the frame, too. Where the picture has not changed, new paint would have the same error, since strokes never
reproduce a picture exactly. Where the paint is close to the frame, it can stay. Departure from zhang2011patches,
section 5, where a patch covers its whole cluster: an opening mouth would then stay closed. Departure from
hertzmann2000video, section 3, which uses only the difference to the previous frame.
"""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Frame, Mask, Plane
from pipeline.gaussian import sigma_in_cells, upscale_cells, wide_gaussian
from pipeline.kernels.jit import kernel
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.methods.patches.window_flow import vector_norm
from pipeline.video.depth import as_uint8

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
LEAST_COVERAGE = 0.1
"""Minimum of the share of painted pixels around a cell, by which the limit is multiplied there."""
CELL_SIGMAS = 0.7
"""Approximate side, in sigmas of the Gaussian, of the square cells in which paint and frame are compared. A blurred
picture has no finer detail, and the cost of a Gaussian grows with its sigma."""
SPECK_PX, MIN_MEAN_WEIGHT = 6.0, 0.7
"""Isolated specks are removed where the mean weight of a Gaussian neighbourhood is low: its sigma, px of a frame 344 px
high, and that mean weight."""

Rendering: TypeAlias = tuple[Frame, AnyArray]
"""A picture, uint8 (h, w, 3), and its painting, uint8 or uint16 (h, w, 3), RGB."""


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


def relative_sharpness(picture: Frame, frame: Frame, unit: float, size: tuple[int, int] | None = None) -> Plane:
    """Local detail of a picture relative to that of a frame, 0..1: float32 (h, w).

    A mean of misaligned frames is blurred and has less detail. One gray level is added to both, so that noise in
    smooth areas has little effect.

    Args:
        picture: uint8 (h, w, 3), a mean of frames.
        frame: uint8 (h, w, 3).
        unit: pixels of the picture per pixel of a frame 344 px high.
        size: (width, height) of the result; None = the picture's.
    """
    ratio = np.minimum(SHARPNESS_GAIN * (_local_detail(picture, unit) + 1) / (_local_detail(frame, unit) + 1), 1)
    return np.asarray(cv2.resize(ratio, size or picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def _local_detail(picture: Frame, unit: float) -> Plane:
    """Local mean of absolute detail, gray levels: float32, on a grid of `CELL_PX` cells."""
    gray = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
    detail = cv2.absdiff(gray, wide_gaussian(gray, DETAIL_PX * unit))
    height, width = gray.shape
    step = max(int(CELL_PX * unit), 1)
    size = max(width // step, 1), max(height // step, 1)
    small = cv2.resize(detail, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), NEIGHBOURHOOD_PX * unit / step), np.float32)


def fine_sigma_px(grid: WorkingGrid) -> float:
    """`FINE_PX` in pixels of the frame, at least 1."""
    return max(FINE_PX * grid.unit, 1.0)


def cell_px(sigma_px: float) -> int:
    """Side of the cells on which paint and frame are compared, px."""
    return max(round(CELL_SIGMAS * sigma_px), 1)


def misfit(frame: Frame, rendering: Rendering, limit: Plane, sigma_px: float, where: Mask | None = None) -> Plane:
    """Misfit of paint and a frame: geometric mean of two RGB distances, in units of the limit.

        sqrt(|frame - picture| |frame - painting|) / limit

    Returns:
        float32, one value for each cell of `cell_px(sigma_px)` px; the last row and column may be incomplete cells.

    Args:
        rendering: the paint, and the picture that it was painted from.
        limit: float32 (h, w), tolerated RGB distance.
        sigma_px: sigma of the Gaussian applied to both differences, px.
        where: bool (h, w), the pixels that have paint; None = all. Elsewhere the differences are 0; to compensate, the
            limit is multiplied by the share of painted pixels around each cell.
    """
    cell = cell_px(sigma_px)
    rows, columns = (-(-length // cell) for length in frame.shape[:2])
    sigma = sigma_in_cells(sigma_px, cell)
    means = np.empty((2, rows, columns, 3), np.float32)
    tolerated: AnyArray = cv2.resize(limit, (columns, rows), interpolation=cv2.INTER_LINEAR)
    coverage = np.empty((rows, columns), np.float32)
    every = np.ones(limit.shape, np.bool_) if where is None else where
    _mean_differences(frame, (rendering[0], as_uint8(rendering[1])), every, cell, means, coverage)
    if where is not None:
        tolerated = tolerated * np.maximum(cv2.GaussianBlur(coverage, (0, 0), sigma), np.float32(LEAST_COVERAGE))
    changed, wrong = (vector_norm(cv2.GaussianBlur(plane, (0, 0), sigma)) for plane in means)
    return np.asarray(np.sqrt(changed * wrong) / tolerated, np.float32)


@kernel
def _mean_differences(
    frame: Frame, rendering: tuple[Frame, Frame], where: Mask, cell: int, out: NDArray[np.float32], coverage: Plane
) -> None:
    """Mean difference between the frame and picture and painting in each cell, 0 outside `where`; and the share of the
    cell inside `where`."""
    height, width = frame.shape[:2]
    for row in range(out.shape[1]):
        bottom = min((row + 1) * cell, height)
        for column in range(out.shape[2]):
            right = min((column + 1) * cell, width)
            share = np.float32(1) / np.float32((bottom - row * cell) * (right - column * cell))
            inside = 0
            for k in range(2):
                red, green, blue, inside = 0, 0, 0, 0
                for y in range(row * cell, bottom):
                    for x in range(column * cell, right):
                        if where[y, x]:
                            inside += 1
                            red += int(frame[y, x, 0]) - int(rendering[k][y, x, 0])
                            green += int(frame[y, x, 1]) - int(rendering[k][y, x, 1])
                            blue += int(frame[y, x, 2]) - int(rendering[k][y, x, 2])
                out[k, row, column, 0] = share * np.float32(red)
                out[k, row, column, 1] = share * np.float32(green)
                out[k, row, column, 2] = share * np.float32(blue)
            coverage[row, column] = share * np.float32(inside)


def patch_weight(frame: Frame, rendering: Rendering, limit: Plane, grid: WorkingGrid) -> Plane:
    """Weight with which a patch can be used in its part of a frame: float32 (h, w), 0..1.

    The weight falls from 1 to 0 as the misfit rises from 1 to 1.5. It is also 0 around rejected pixels and on isolated
    specks. It is computed for cells (`cell_px`) and interpolated between them.

    Args:
        frame: uint8 (h, w, 3), the part of the frame that the patch covers.
        rendering: the patch, warped to that part.
        limit: float32 (h, w), tolerated RGB distance.
    """
    sigma_px = fine_sigma_px(grid)
    cell = cell_px(sigma_px)
    rows, columns = (-(-length // cell) for length in frame.shape[:2])
    unit = grid.unit / cell
    sharp = np.clip(relative_sharpness(rendering[0], frame, grid.unit, (columns, rows)), MIN_SHARPNESS, 1)
    off = misfit(frame, rendering, limit, sigma_px) / sharp**SHARPNESS_POWER
    weight = np.clip(3 - 2 * off, 0, 1)
    weight *= weight * (3 - 2 * weight)
    mean_weight = cv2.GaussianBlur(weight, (0, 0), SPECK_PX * unit)
    reach = 2 * int(REJECTION_RADIUS_PX * unit) + 1
    near_rejected = cv2.dilate((off > REJECTED).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
    kept = np.where(near_rejected & (off > REJECTED_NEARBY), np.float32(0), weight)
    smooth = cv2.GaussianBlur(kept, (0, 0), unit) * np.clip((mean_weight - MIN_MEAN_WEIGHT) * 5, 0, 1)
    return upscale_cells(np.asarray(smooth, np.float32), cell, (frame.shape[0], frame.shape[1]))
