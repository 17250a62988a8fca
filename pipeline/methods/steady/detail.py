"""Restoration of the texture that averaging along the motion has blurred, in two frequency bands."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.buffers import Buffers
from pipeline.frames import Plane
from pipeline.jit import kernel
from pipeline.methods.steady.confidence import Picture

SIGMAS_PX = (0.5, 1.2)
"""Standard deviations of two Gaussian blurs. The first removes the fine band, the second also the middle band."""
CELL_PX = 4
"""Amounts of texture are averaged in cells of this side first."""
WINDOW_CELLS = 5
"""Side of the window, in cells, over which the amounts are averaged."""
MEMORY = np.float32(0.9)
"""Share of the previous frame's amounts in those of a frame. The amount in a single frame flickers as its texture does,
and the amplified texture would flicker with it."""
LARGEST = 3.0
"""Largest gain of a band, so that faint texture does not become noise."""
_LEAST_DETERMINANT = np.float32(1e-3)
"""Added to the determinant, squared gray levels: without texture, the gain is 0."""
_LUMA = np.array([[0.299, 0.587, 0.114]], np.float32)

Amounts = NDArray[np.float32]
"""Mean absolute lightness of bands around each cell, gray levels, float32 (8, rows, columns): fine and middle band of
the result, those of the styled frame, and those of each band of the result when it is divided into bands again (fine of
fine, middle of fine, fine of middle, middle of middle). Without rows before the second frame of a shot."""
NO_AMOUNTS: Amounts = np.empty((8, 0, 0), np.float32)


def restore_detail(
    frames: tuple[Picture, Picture], trust: Plane, share: float, before: Amounts, buffers: Buffers
) -> tuple[Picture, Amounts]:
    """The texture to add to a result, so that its texture is as strong as that of the styled frames around each pixel.

    An average of n frames with independent texture keeps 1/sqrt(n) of its contrast. Amplification restores the
    contrast; the texture stays that of the average, which changes slowly. Where the motion is not trusted, nothing was
    averaged, and amplification would only add flicker. Averaging weakens fine texture more than coarse texture, and
    warping sharpens some edges. With one gain for both bands, the fine band would be too weak or the middle band too
    strong.

    Args:
        frames: the result and the styled frame, float32 (h, w, 3), 0..255.
        trust: confidence in the motion to the previous frame, float32 (h, w), 0..1. The gains are multiplied by it.
        share: of the missing texture that is restored, 0..1.
        before: amounts at the last frame.
        buffers: working memory. It contains the returned texture until the next call with the same `buffers`.

    Returns:
        The texture, float32 (h, w, 3); and the amounts at this frame.
    """
    picture, styled = frames
    blurred = [buffers.get(f"blurred {sigma}", picture.shape) for sigma in SIGMAS_PX]
    for sigma, plane in zip(SIGMAS_PX, blurred, strict=True):
        cv2.GaussianBlur(picture, _kernel_size(sigma), sigma, dst=plane)
    light = [_lightness(plane) for plane in (picture, *blurred)]
    fine, middle = light[0] - light[1], light[1] - light[2]
    planes = (fine, middle, *_bands(_lightness(styled)), *_bands(fine), *_bands(middle))
    amounts = np.stack([_amount(plane) for plane in planes])
    if before.size:
        amounts = MEMORY * before + (1 - MEMORY) * amounts
    size = (picture.shape[1], picture.shape[0])
    gains = [cv2.resize(gain, size, interpolation=cv2.INTER_LINEAR) for gain in _gains(amounts, np.float32(share))]
    texture = buffers.get("texture", picture.shape)
    _amplify(picture, blurred[0], blurred[1], gains[0], gains[1], trust, texture)
    return texture, amounts


def resized_amounts(amounts: Amounts, size: tuple[int, int]) -> Amounts:
    """The amounts for frames of another size (width, height), px."""
    if not amounts.size:
        return amounts
    cells = _cells(size[1], size[0])
    return np.stack([np.asarray(cv2.resize(plane, cells, interpolation=cv2.INTER_LINEAR)) for plane in amounts])


def _gains(amounts: Amounts, share: np.float32) -> tuple[Plane, Plane]:
    """Gains of the fine and of the middle band, -1..LARGEST.

    They solve two linear equations for each cell: after amplification, both bands have the amounts of the styled frame.
    """
    have, want = amounts[:2], amounts[2:4]
    (fine_of_fine, middle_of_fine), (fine_of_middle, middle_of_middle) = amounts[4:6], amounts[6:8]
    fine, middle = share * (want - have)
    determinant = np.maximum(fine_of_fine * middle_of_middle - fine_of_middle * middle_of_fine, 0) + _LEAST_DETERMINANT
    gains = middle_of_middle * fine - fine_of_middle * middle, fine_of_fine * middle - middle_of_fine * fine
    first, second = ((gain / determinant).clip(-1, LARGEST) for gain in gains)
    return first, second


def _lightness(picture: Picture) -> Plane:
    return np.asarray(cv2.transform(picture, _LUMA), np.float32)


def _bands(plane: Plane) -> tuple[Plane, Plane]:
    """Fine and middle band of a plane of lightness."""
    first, second = (cv2.GaussianBlur(plane, _kernel_size(sigma), sigma) for sigma in SIGMAS_PX)
    return plane - first, first - second


def _kernel_size(sigma_px: float) -> tuple[int, int]:
    """Width and height of a blur's kernel, px: up to 2.5 sigma from its centre."""
    side = 2 * round(2.5 * sigma_px) + 1
    return side, side


def _amount(band: Plane) -> Plane:
    """Mean absolute value of a band in each cell, averaged over the window, float32 (rows, columns)."""
    cells = cv2.resize(np.abs(band), _cells(*band.shape), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.blur(cells, (WINDOW_CELLS, WINDOW_CELLS)), np.float32)


def _cells(height: int, width: int) -> tuple[int, int]:
    """Columns and rows of cells that cover a frame."""
    return -(-width // CELL_PX), -(-height // CELL_PX)


@kernel
def _amplify(picture: Any, soft: Any, softer: Any, fine: Any, middle: Any, trust: Any, texture: Any) -> None:
    """Fill `texture` with trust (fine (picture - soft) + middle (soft - softer)); `fine` and `middle` are planes of
    gains."""
    height, width, channels = picture.shape
    for y in range(height):
        for x in range(width):
            first, second = trust[y, x] * fine[y, x], trust[y, x] * middle[y, x]
            for c in range(channels):
                between = soft[y, x, c]
                texture[y, x, c] = first * (picture[y, x, c] - between) + second * (between - softer[y, x, c])
