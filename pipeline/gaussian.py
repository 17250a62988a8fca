"""Gaussian blurs with a large sigma, computed on coarse cells: a blurred picture has no detail that they would lose."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

CELL_SIGMAS = 0.5
"""Side of the cells that are averaged before the blur, in sigmas. At 0.5, the blur differs from the exact one by less
than half a gray level on average."""


def wide_gaussian(picture: NDArray[np.uint8], sigma_px: float) -> NDArray[np.uint8]:
    """Gaussian blur of a picture, uint8 (h, w) or (h, w, 3); exact for sigma below 4 px.

    Args:
        sigma_px: standard deviation, px, > 0.
    """
    cell = int(CELL_SIGMAS * sigma_px)
    height, width = picture.shape[:2]
    if cell <= 1 or min(height, width) < 2 * cell:
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), np.uint8)
    small = cv2.resize(picture, (width // cell, height // cell), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma_in_cells(sigma_px, cell), borderType=cv2.BORDER_REFLECT)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)


def sigma_in_cells(sigma_px: float, cell: int) -> float:
    """Sigma, in cells, of the blur to apply after averaging over cells, so that both together have `sigma_px`.

    The variances add up; the mean over a cell has (cell^2 - 1) / 12 px^2.
    """
    return math.sqrt(sigma_px**2 - (cell**2 - 1) / 12) / cell


def upscale_cells(cells: NDArray[np.float32], cell: int, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Values of square cells, interpolated bilinearly at the pixels of a picture: float32 of `shape` (h, w).

    Args:
        cells: float32 (rows, columns) or (rows, columns, n). The last row and column may reach beyond the picture.
        cell: side of a cell, px; 1 returns `cells` itself.
    """
    if cell == 1:
        return cells
    rows, columns = cells.shape[:2]
    wide = cv2.resize(cells, (columns * cell, rows * cell), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(wide[: shape[0], : shape[1]], np.float32)
