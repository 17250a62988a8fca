"""The smoothed structure tensor and its tangent field.

Directions have no sign and cannot be averaged as vectors, since opposite sides of a line would cancel. Tensors can be
averaged. Smoothing over space or time is therefore done on the tensor, and the tangent is computed last.
"""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Plane
from pipeline.gaussian import sigma_in_cells, upscale_cells
from pipeline.kernels.jit import kernel

Tensors: TypeAlias = NDArray[np.float32]
"""A symmetric 2 x 2 tensor per pixel, `float32` (3, height, width): the planes xx, xy, yy."""

CELL_SIGMAS = 0.75
"""Side of the cells of `doubled_tangents`, in sigmas."""
FLAT = 0.01
"""Difference of the eigenvalues, (gray levels/px)^2, up to which the direction is undefined: 0.1 gray levels/px."""


def structure_tensor(gray: Plane, sigma_px: float) -> Tensors:
    """Gaussian-blurred outer product of the gray gradient with itself: float32 (3, h, w), (gray levels/px)^2.

    Args:
        gray: float32 (h, w), gray levels.
        sigma_px: sigma of the Gaussian, > 0; structures closer than this share a direction.

    The gradient is Scharr's, the 3 x 3 operator with the least bias in direction; border pixels are replicated.
    """
    dx = cv2.Scharr(gray, cv2.CV_32F, 1, 0, scale=1 / 32, borderType=cv2.BORDER_REPLICATE)
    dy = cv2.Scharr(gray, cv2.CV_32F, 0, 1, scale=1 / 32, borderType=cv2.BORDER_REPLICATE)
    out = np.empty((3, *gray.shape), np.float32)
    for plane, (a, b) in zip(out, ((dx, dx), (dx, dy), (dy, dy)), strict=True):
        np.multiply(a, b, out=plane)
        cv2.GaussianBlur(plane, (0, 0), sigma_px, dst=plane)
    return out


def tangent_field(tensors: Tensors, flat: float = FLAT) -> Flow:
    """Unit vector along the structure (minor eigenvector), float32 (h, w, 2): (x, y); (0, 0) where undefined.

    The sign is arbitrary: t and -t are the same direction, and neighbours may differ in sign.

    Args:
        tensors: float32 (3, h, w), smoothed.
        flat: largest difference of the eigenvalues at which the direction is undefined, (gray levels/px)^2, >= 0.

    Source: the edge tangent flow of kang2007coherent, section 2.1.

    Departure: the paper filters vectors iteratively, weighted by similarity; here tensors are smoothed once, linearly.
    Half-angle formulas are used: square roots and divisions round alike on every processor, arc tangents do not.
    """
    out = np.empty((*tensors.shape[1:], 2), np.float32)
    _tangents(tensors, np.float32(flat), out)
    return out


@kernel
def _tangents(tensors: Tensors, flat: np.float32, out: Flow) -> None:
    half, one = np.float32(0.5), np.float32(1.0)
    _, height, width = tensors.shape
    for y in range(height):
        for x in range(width):
            u, v = tensors[0, y, x] - tensors[2, y, x], tensors[1, y, x] + tensors[1, y, x]
            length = np.sqrt(u * u + v * v)
            known = length > flat
            scale = half / (length if known else one)
            larger = np.sqrt((length + abs(u)) * scale) if known else one
            smaller = v * scale / larger
            steep = u < 0.0
            tx = larger if steep else smaller
            ty = -smaller if steep else -larger
            out[y, x, 0] = tx if known else 0.0
            out[y, x, 1] = ty if known else 0.0


def doubled_tangents(picture: NDArray[np.uint8], sigma_px: float, flat: float = FLAT) -> NDArray[np.float32]:
    """The tangent field as (cos 2a, sin 2a) of the angle a, of length 0..1: float32 (h, w, 2); (0, 0) where undefined.

    If sigma is large, the structure tensor is averaged over square cells before it is smoothed, because a smoothed
    field has no finer detail. Vectors are interpolated between cells; where the direction changes, they are shorter
    than 1.

    Args:
        picture: uint8 (h, w, channels), gray levels; the tensor is the mean of the channels' tensors.
        sigma_px: as for `structure_tensor`.
        flat: as for `tangent_field`.

    Source: dizenzo1986gradient (tensor of several channels). The lightness alone has no edge between colours of equal
    lightness, such as red and brown.
    """
    cell = max(round(CELL_SIGMAS * sigma_px), 1)
    height, width, channels = picture.shape
    tensors = np.empty((3, -(-height // cell), -(-width // cell)), np.float32)
    _mean_tensors(picture.reshape(height, width * channels), channels, cell, tensors)
    sigma = sigma_in_cells(sigma_px, cell)
    for plane in tensors:
        cv2.GaussianBlur(plane, (0, 0), sigma, dst=plane)
    out = np.empty((*tensors.shape[1:], 2), np.float32)
    _doubled(tensors, np.float32(flat), out)
    return upscale_cells(out, cell, (height, width))


@kernel
def _mean_tensors(picture: NDArray[np.uint8], channels: int, cell: int, out: Tensors) -> None:
    """Mean over each cell and all channels of the products of the Scharr gradient's components; border pixels are
    replicated.

    Args:
        picture: uint8 (h, w * channels), interleaved.
    """
    height, length = picture.shape
    scale = np.float32(1 / 1024)
    xx, xy, yy = np.empty(length, np.float32), np.empty(length, np.float32), np.empty(length, np.float32)
    across, down = np.empty(length + 2 * channels, np.int32), np.empty(length + 2 * channels, np.int32)
    for row in range(out.shape[1]):
        xx[:], xy[:], yy[:] = 0, 0, 0
        bottom = min((row + 1) * cell, height)
        for y in range(row * cell, bottom):
            above, below = picture[max(y - 1, 0)], picture[min(y + 1, height - 1)]
            here = picture[y]
            inner_across, inner_down = across[channels : channels + length], down[channels : channels + length]
            for k in range(length):  # this and the next but one vectorise
                inner_across[k] = 3 * (np.int32(above[k]) + np.int32(below[k])) + 10 * np.int32(here[k])
                inner_down[k] = np.int32(below[k]) - np.int32(above[k])
            for k in range(channels):
                across[k], down[k] = across[channels + k], down[channels + k]
                across[length + channels + k], down[length + channels + k] = across[length + k], down[length + k]
            right_across, right_down = across[2 * channels :], down[2 * channels :]
            for k in range(length):
                dx = np.float32(right_across[k] - across[k])
                dy = np.float32(3 * (down[k] + right_down[k]) + 10 * inner_down[k])
                xx[k] += dx * dx
                xy[k] += dx * dy
                yy[k] += dy * dy
        for column in range(out.shape[2]):
            left, right = channels * column * cell, min(channels * (column + 1) * cell, length)
            share = scale / np.float32((right - left) * (bottom - row * cell))
            a, b, c = np.float32(0), np.float32(0), np.float32(0)
            for k in range(left, right):
                a += xx[k]
                b += xy[k]
                c += yy[k]
            out[0, row, column], out[1, row, column], out[2, row, column] = a * share, b * share, c * share


@kernel
def _doubled(tensors: Tensors, flat: np.float32, out: NDArray[np.float32]) -> None:
    _, height, width = tensors.shape
    for y in range(height):
        for x in range(width):
            u, v = tensors[2, y, x] - tensors[0, y, x], tensors[1, y, x] + tensors[1, y, x]
            length = np.sqrt(u * u + v * v)
            known = length > flat
            scale = np.float32(1) / (length if known else np.float32(1))
            out[y, x, 0] = u * scale if known else np.float32(0)
            out[y, x, 1] = -v * scale if known else np.float32(0)
