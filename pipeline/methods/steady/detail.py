"""Sharpening of the previous result, so that results keep the texture that averaging along the motion would blur.

Two filters along an axis divide a picture into bands: u = (0, -1, 2, -1, 0) / 4 and q = (1, -4, 6, -4, 1) / 16, with
the responses s and s^2 for s = (1 - cos(frequency)) / 2. The fine band is q. The middle band is u - q, which is
strongest at half of the Nyquist frequency.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.buffers import Buffers
from pipeline.kernels.executors import INLINE, FrameExecutor
from pipeline.kernels.jit import kernel
from pipeline.methods.steady.confidence import Picture, TrustedMotion


class DetailParams(NamedTuple):
    """Constants of the return of detail."""

    cell_px: int = 4
    """Amounts of texture are averaged in cells of this side first."""
    window_cells: int = 9
    """Side of the window, in cells, over which the amounts are averaged."""
    memory: np.float32 = np.float32(0.9)
    """Share of the previous frame's amounts in those of a frame. The amount in a single frame flickers as its
    texture does, and the sharpened texture would flicker with it."""
    goal: np.float32 = np.float32(0.93)
    """Amount of the Laplacian that is restored, relative to the styled frames. The last twentieth would flicker
    much."""
    fine_rate: np.float32 = np.float32(20)
    fine_largest: np.float32 = np.float32(1)
    """Gain of the fine band for each relative shortage of the Laplacian, and the largest gain."""
    middle_rate: np.float32 = np.float32(1.5)
    middle_largest: np.float32 = np.float32(0.3)
    """Gain of the middle band for each relative shortage or excess of that band, and the largest gain of either
    sign."""
    faint: np.float32 = np.float32(0.1)
    """Added to the styled frames' amounts, gray levels, so that faint texture does not become noise."""


DETAIL = DetailParams()


HALF_PIXEL = np.array([0.2, -0.25], np.float32)
"""Gains of the two bands half-way between two pixels. There, OpenCV's cubic interpolation weakens the fine band and
amplifies the frequencies below, which a recursion would accumulate."""
_LUMA = np.array([[0.299, 0.587, 0.114]], np.float32)

Amounts: TypeAlias = NDArray[np.float32]
"""Mean absolute lightness around each cell, gray levels, float32 (4, rows, columns): a quarter of the Laplacian and the
middle band of the result, and those of the styled frame. Without rows before the second frame of a shot."""
NO_AMOUNTS: Amounts = np.empty((4, 0, 0), np.float32)


def amounts_of(
    result: Picture, styled: Picture, before: Amounts, buffers: Buffers, background: FrameExecutor = INLINE
) -> Amounts:  # fmt: skip
    """Amounts at a frame, averaged with those at the last frame, `before`.

    Args:
        result, styled: float32 (h, w, 3), 0..255.
        buffers: working memory.
        background: may take rows of the pictures.
    """
    laplacian, middle = (buffers.get(name, result.shape[:2]) for name in ("laplacian", "middle"))
    planes = []
    for picture in (result, styled):
        light = np.asarray(cv2.transform(picture, _LUMA), np.float32)
        background.rows(partial(_strengths, light, laplacian, middle), len(light))
        planes += [_around_cells(laplacian), _around_cells(middle)]
    amounts = np.stack(planes)
    return DETAIL.memory * before + (1 - DETAIL.memory) * amounts if before.size else amounts


def sharpen(
    moved: Picture, back: TrustedMotion, amounts: Amounts, share: float, out: Picture,
    background: FrameExecutor = INLINE,
) -> None:  # fmt: skip
    """Fill `out` with the moved previous result, sharpened as far as results have less texture than the styled frames.

    An average of n frames with independent texture keeps 1/sqrt(n) of its contrast, and each interpolation weakens the
    finest texture. Sharpened within the recursion, texture keeps its contrast and moves with the scene. If each result
    were amplified outside the recursion, the gains would be large, and it would flicker more. Two bands are sharpened:
    with one gain, edges become too strong before the finest texture is strong enough. Values stay between the least and
    the largest of the pixel and its four neighbours before sharpening, so that edges have no halos.

    Args:
        moved: the previous result, moved along the motion, float32 (h, w, 3), 0..255.
        back: the motion. The gains are multiplied by the third power of the trust: sharp texture flickers where the
            motion is inaccurate.
        amounts: amounts at the previous frame; may be empty.
        share: of the missing texture that is restored, 0..1.
        out: float32 (h, w, 3).
        background: may take rows of it.
    """
    height, width = moved.shape[:2]
    fine, middle = (_resized(np.float32(share) * gain, (width, height)) for gain in _gains(amounts))
    wide, sharp = moved.reshape(height, -1), out.reshape(height, -1)
    bands = fine, middle, HALF_PIXEL
    background.rows(partial(_sharpen, wide, back.to, back.trust, bands, sharp), height)


def resized_amounts(amounts: Amounts, size: tuple[int, int]) -> Amounts:
    """The amounts for frames of another size (width, height), px."""
    if not amounts.size:
        return amounts
    cells = _cells(size[1], size[0])
    return np.stack([_resized(plane, cells) for plane in amounts])


def _resized(plane: Plane, size: tuple[int, int]) -> Plane:
    """The plane, interpolated to the size (width, height)."""
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _gains(amounts: Amounts) -> tuple[Plane, Plane]:
    """Gains of the fine and of the middle band for each cell, or 0 without amounts."""
    if not amounts.size:
        return np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32)
    laplacian, middle, wanted_laplacian, wanted_middle = amounts
    fine = DETAIL.fine_rate * (DETAIL.goal * wanted_laplacian - laplacian) / (wanted_laplacian + DETAIL.faint)
    middle = DETAIL.middle_rate * (wanted_middle - middle) / (wanted_middle + DETAIL.faint)
    return fine.clip(0, DETAIL.fine_largest), middle.clip(-DETAIL.middle_largest, DETAIL.middle_largest)


def _around_cells(plane: Plane) -> Plane:
    """Mean in each cell, averaged over the window, float32 (rows, columns)."""
    cells = cv2.resize(plane, _cells(*plane.shape), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.blur(cells, (DETAIL.window_cells, DETAIL.window_cells)), np.float32)


def _cells(height: int, width: int) -> tuple[int, int]:
    """Columns and rows of cells that cover a frame."""
    return -(-width // DETAIL.cell_px), -(-height // DETAIL.cell_px)


@kernel
def _extend(row: Any, channels: int, out: Any) -> None:
    """Fill `out` with the row and two more pixels at either end, which equal the first and the last."""
    values = row.shape[0]
    for j in range(values):
        out[2 * channels + j] = row[j]
    for j in range(2 * channels):
        out[j] = row[j % channels]
        out[2 * channels + values + j] = row[values - channels + j % channels]


@kernel
def _strengths(light: Any, laplacian: Any, middle: Any, first_row: int, end_row: int) -> None:
    """Fill rows of the planes with the absolute values of u and of u - q, added along both axes."""
    height, width = light.shape
    wide = np.empty(width + 4, np.float32)
    for y in range(first_row, end_row):
        _extend(light[y], 1, wide)
        above, below = light[max(y - 1, 0)], light[min(y + 1, height - 1)]
        top, bottom = light[max(y - 2, 0)], light[min(y + 2, height - 1)]
        first, second = laplacian[y], middle[y]
        for x in range(width):
            near = wide[x + 1] + wide[x + 3] + above[x] + below[x]
            far = wide[x] + wide[x + 4] + top[x] + bottom[x]
            u = wide[x + 2] - np.float32(0.25) * near
            q = np.float32(0.0625) * (np.float32(12) * wide[x + 2] - np.float32(4) * near + far)
            first[x], second[x] = abs(u), abs(u - q)


@kernel
def _sharpen(moved: Any, to: Any, trust: Any, bands: Any, out: Any, first_row: int, end_row: int) -> None:
    """Fill rows of `out`, see `sharpen`; rows of `moved` and `out` are interleaved channels, `bands` are the planes of
    gains of the fine and of the middle band, and the gains half-way between pixels."""
    (xs, ys), (fine, middle, half_pixel) = to, bands
    height, width = trust.shape
    values = 3 * width
    wide = np.empty(values + 12, np.float32)
    gains = np.empty((4, values), np.float32)
    fine_x, middle_x, fine_y, middle_y = gains[0], gains[1], gains[2], gains[3]
    for y in range(first_row, end_row):
        for x in range(width):
            power = trust[y, x] * trust[y, x] * trust[y, x]
            across, along = xs[y, x] - np.floor(xs[y, x]), ys[y, x] - np.floor(ys[y, x])
            across, along = np.float32(4) * across * (1 - across), np.float32(4) * along * (1 - along)
            for j in range(3 * x, 3 * x + 3):
                fine_x[j] = power * fine[y, x] + half_pixel[0] * across
                middle_x[j] = power * middle[y, x] + half_pixel[1] * across
                fine_y[j] = power * fine[y, x] + half_pixel[0] * along
                middle_y[j] = power * middle[y, x] + half_pixel[1] * along
        _extend(moved[y], 3, wide)
        above, below = moved[max(y - 1, 0)], moved[min(y + 1, height - 1)]
        top, bottom = moved[max(y - 2, 0)], moved[min(y + 2, height - 1)]
        sharp = out[y]
        for j in range(values):
            value, left, right, up, down = wide[j + 6], wide[j + 3], wide[j + 9], above[j], below[j]
            ux = np.float32(0.25) * (np.float32(2) * value - left - right)
            uy = np.float32(0.25) * (np.float32(2) * value - up - down)
            qx = np.float32(0.0625) * (np.float32(6) * value - np.float32(4) * (left + right) + wide[j] + wide[j + 12])
            qy = np.float32(0.0625) * (np.float32(6) * value - np.float32(4) * (up + down) + top[j] + bottom[j])
            changed = value + fine_x[j] * qx + fine_y[j] * qy + middle_x[j] * (ux - qx) + middle_y[j] * (uy - qy)
            least, most = min(min(left, right), min(up, down)), max(max(left, right), max(up, down))
            sharp[j] = min(max(changed, min(least, value)), max(most, value))
