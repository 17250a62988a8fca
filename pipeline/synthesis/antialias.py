"""Anti-aliased rendering of offset fields: strokes move by fractions of a pixel, and seams are not jagged.

Departure from benard2013stylizing, where every output pixel is a copy of a style pixel: a copied stroke, and a seam
between pieces of the style, then moves by whole pixels, which flickers where the scene moves. Here a pixel is the mean
of the colours that nine pieces show there: its own, and those of its eight neighbours, weighted 1 2 1 along x and y.
Inside a piece, all nine are equal. Pieces are sampled at fractional offsets by cubic convolution (a = -1/2). The mean
has colours that the style lacks; `exemplar.PaintingColours` replaces each by the nearest colour of the style.

This is the specification of `antialias.cl`, which gives the same bytes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.synthesis.energy import NO_DIRECTION, cosines
from pipeline.synthesis.images import Bytes, Offsets, StyleImage
from pipeline.synthesis.reference_energy import StyleDirections, extrapolated_offset

STEP_BITS = 4
"""Bits of the fraction of a sample's position."""
_STEPS = 1 << STEP_BITS
"""Number of sub-pixel steps of a sample along each axis."""
_NO_BYTES = np.zeros((0, 0), np.uint8)


class RenderInputs(NamedTuple):
    """Arguments of the kernel besides style and offsets.

    Attributes:
        taps: float32 (16, 4), weights of cubic convolution by fraction.
        bins: uint8 (h, w), direction of each pixel; length 0 = pieces are not rotated.
        paintable: uint8 (h, w), 0 = the pixel's piece does not count for its neighbours; length 0 = all count.
        directions: directions of the style.
    """

    taps: NDArray[np.float32]
    bins: Bytes
    paintable: Bytes
    directions: StyleDirections


def antialiased(
    style: StyleImage, offsets: Offsets, bins: Bytes | None = None, paintable: Bytes | None = None
) -> Bytes:
    """Render offsets between pixels, uint8 (h, w, 3), or (h, w, 4) with straight alpha if the style has opacity.

    Args:
        offsets: float32 (h, w, 2), defined at every pixel.
        bins: direction of each pixel, uint8 (h, w); None = pieces are not rotated.
        paintable: uint8 (h, w), 0 = the pixel may not be painted; None = all may be.
    """
    own_bins, style_bins = (_NO_BYTES, _NO_BYTES) if bins is None or style.bins is None else (bins, style.bins)
    directions = StyleDirections(style_bins, cosines(), *style.size)
    inputs = RenderInputs(
        cubic_taps(), own_bins, _NO_BYTES if paintable is None else paintable, directions
    )  # fmt: skip
    out = np.empty((*offsets.shape[:2], style.colours.shape[2]), np.uint8)
    _render(np.ascontiguousarray(style.colours), np.ascontiguousarray(offsets), inputs, out)
    return out


def cubic_taps() -> NDArray[np.float32]:
    """Weights of the four samples of cubic convolution (Keys 1981, a = -1/2) for each sixteenth of a pixel."""
    t = np.arange(_STEPS) / _STEPS
    weights = (-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, -(t**2) + t**3)
    return np.ascontiguousarray(np.stack(weights, -1) / 2, np.float32)


@kernel
def _render(style: Bytes, offsets: Offsets, inputs: RenderInputs, out: Bytes) -> None:
    height, width, channels = out.shape
    total = np.empty(5, np.float32)
    for y in range(height):
        for x in range(width):
            own_x, own_y = _position(offsets, inputs, x, y, 0, 0)
            own_weight = np.float32(4)
            total[:] = 0
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    nx, ny = x + dx, y + dy
                    if (dx == 0 and dy == 0) or not (0 <= nx < width and 0 <= ny < height):
                        continue
                    if inputs.paintable.size and not inputs.paintable[ny, nx]:
                        continue
                    weight = np.float32(1 if dx and dy else 2)
                    at_x, at_y = _position(offsets, inputs, nx, ny, -dx, -dy)
                    if at_x == own_x and at_y == own_y:
                        own_weight += weight
                    else:
                        _add(style, inputs.taps, at_x, at_y, weight, total)
            _add(style, inputs.taps, own_x, own_y, own_weight, total)
            opacity = max(total[3], np.float32(1e-6))
            for c in range(3):
                out[y, x, c] = np.uint8(np.rint(min(max(total[c] / opacity, np.float32(0)), np.float32(255))))
            if channels == 4:
                shown = min(max(total[3] / total[4], np.float32(0)), np.float32(1))
                out[y, x, 3] = np.uint8(np.rint(np.float32(255) * shown))


@kernel
def _position(offsets: Offsets, inputs: RenderInputs, x: int, y: int, dx: int, dy: int) -> tuple[int, int]:
    """Position in the style, in steps, that the piece of pixel (x, y) shows at the pixel (x + dx, y + dy)."""
    direction = inputs.bins[y, x] if inputs.bins.size else NO_DIRECTION
    at_x, at_y = extrapolated_offset(
        offsets[y, x, 0], offsets[y, x, 1], np.float32(dx), np.float32(dy), direction, inputs.directions
    )
    return int(np.rint(at_x * np.float32(_STEPS))), int(np.rint(at_y * np.float32(_STEPS)))


@kernel
def _add(
    style: Bytes, taps: NDArray[np.float32], at_x: int, at_y: int, weight: np.float32, total: NDArray[np.float32]
) -> None:
    """Add a sample of the style to `total`: colours times opacity, opacity (0..1), and the weight."""
    height, width, channels = style.shape
    x, y, fx, fy = at_x >> STEP_BITS, at_y >> STEP_BITS, at_x & _STEPS - 1, at_y & _STEPS - 1
    total[4] += weight
    for j in range(4 if fy else 1):
        sy = min(max(y + j - 1 if fy else y, 0), height - 1)
        row_weight = weight * taps[fy, j] if fy else weight
        for i in range(4 if fx else 1):
            sx = min(max(x + i - 1 if fx else x, 0), width - 1)
            share = row_weight * taps[fx, i] if fx else row_weight
            if channels == 4:
                share *= np.float32(style[sy, sx, 3]) / np.float32(255)
            total[0] += share * np.float32(style[sy, sx, 0])
            total[1] += share * np.float32(style[sy, sx, 1])
            total[2] += share * np.float32(style[sy, sx, 2])
            total[3] += share
