"""Preparation of a painting as exemplar: size, spectrum, and colours that remain those of the painting."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.synthesis.images import Bytes, halved

_CELL_BITS = 5
"""Bits of a channel that select the cell of a colour."""
_CELLS = 1 << _CELL_BITS
_CELL_LEVELS = 256 // _CELLS
_COLOURS = 1 << 24
"""Number of colours of 8 bits per channel."""
VIDEO_SHARPNESS = 0.6
"""Contrast of neighbouring pixels in videos, relative to the contrast at half resolution."""
_SIGMA_STEPS_PX = tuple(step / 8 for step in range(17))
"""Tried standard deviations of the Gaussian, px."""


def natural_size(painting: tuple[int, int], frame: tuple[int, int]) -> float:
    """Scale at which a painting has as many pixels as a frame, so that a stroke takes the same share of both.

    Args:
        painting, frame: (width, height), px.
    """
    return math.sqrt(frame[0] * frame[1] / (painting[0] * painting[1]))


def resized(picture: Bytes, scale: float) -> Bytes:
    """Scale a picture, uint8 (h, w, 3 or 4): area average if it becomes smaller, cubic if it becomes larger."""
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC))


def contrast(gray: NDArray[np.float32]) -> float:
    """Mean absolute difference of neighbouring pixels, gray levels."""
    return float(np.abs(np.diff(gray, axis=0)).mean() + np.abs(np.diff(gray, axis=1)).mean())


def natural_sigma(picture: Bytes) -> float:
    """Standard deviation of the Gaussian that gives a painting the sharpness of a video, px; 0 = no blur is needed.

    In natural scenes every octave has the same contrast, so that the contrast of neighbouring pixels does not depend on
    the resolution; lens and codec lower it at full resolution. In a sharpened scan it is higher: noise instead of
    strokes, which flickers with every movement that is no whole number of pixels.

    Args:
        picture: uint8 (h, w, 3 or 4).
    """
    gray = cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_RGB2GRAY).astype(np.float32)
    for sigma in _SIGMA_STEPS_PX:
        blurred = gray if sigma == 0 else np.asarray(cv2.GaussianBlur(gray, (0, 0), sigma), np.float32)
        if contrast(blurred) <= VIDEO_SHARPNESS * contrast(np.asarray(halved(blurred), np.float32)):
            break
    return sigma


class PaintingColours:
    """The colours of a painting. Results of searches are cached, in at most 64 MiB.

    Thread-safe: two threads that search for the same colour find the same result.

    Args:
        painting: uint8 (h, w, 3 or 4). With alpha, only the colours of visible pixels count, if any pixel is visible.
    """

    def __init__(self, painting: Bytes) -> None:
        known = np.zeros(_COLOURS, np.bool_)
        known[_codes(_visible(painting))] = True
        colours = np.flatnonzero(known)
        cells = _cell_of(colours)
        by_cell = np.argsort(cells, kind="stable")
        self._colours = colours[by_cell]
        self._starts = np.searchsorted(cells[by_cell], np.arange(_CELLS**3 + 1)).astype(np.int64)
        self._found = np.zeros(_COLOURS, np.int32)
        """Number of the nearest palette colour of each colour, plus 1; 0 = not searched yet."""

    def nearest(self, picture: Bytes) -> Bytes:
        """Replace each colour of a picture by the nearest one of the painting (Euclidean in RGB); alpha stays.

        Args:
            picture: uint8 (h, w, 3 or 4).
        """
        out = picture.copy()
        _replace(out.reshape(-1, out.shape[-1]), self._colours, self._starts, self._found)
        return out


def _visible(painting: Bytes) -> Bytes:
    """The visible pixels of a painting, uint8 (1, pixels, 3); all of them if none is visible."""
    colours = painting[..., :3].reshape(1, -1, 3)
    if painting.shape[2] == 3 or not painting[..., 3].any():
        return colours
    return colours[:, painting[..., 3].ravel() > 0]


def _codes(picture: Bytes) -> NDArray[np.int64]:
    """Colours as numbers 0xRRGGBB, (pixels,)."""
    flat = picture.reshape(-1, 3).astype(np.int64)
    return flat[:, 0] << 16 | flat[:, 1] << 8 | flat[:, 2]


def _cell_of(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    shift = 8 - _CELL_BITS
    red, green, blue = codes >> 16 + shift, (codes >> 8 & 255) >> shift, (codes & 255) >> shift
    return np.asarray((red * _CELLS + green) * _CELLS + blue, np.int64)


@kernel
def _axis_distance(value: int, cell: int) -> int:
    """Distance of a value of a channel from the values of a cell, gray levels; 0 inside."""
    first = cell * _CELL_LEVELS
    return max(first - value, value - (first + _CELL_LEVELS - 1), 0)


@kernel
def _replace(pixels: Bytes, palette: NDArray[np.int64], starts: NDArray[np.int64], found: NDArray[np.int32]) -> None:
    """Replace the colours of pixels, (pixels, 3 or 4), in place; `found`: see `PaintingColours`."""
    for i in range(len(pixels)):
        wanted = int(pixels[i, 0]) << 16 | int(pixels[i, 1]) << 8 | int(pixels[i, 2])
        if found[wanted] == 0:
            found[wanted] = _nearest_colour(wanted, palette, starts) + 1
        code = found[wanted] - 1
        pixels[i, 0], pixels[i, 1], pixels[i, 2] = code >> 16, code >> 8 & 255, code & 255


@kernel
def _nearest_colour(wanted: int, palette: NDArray[np.int64], starts: NDArray[np.int64]) -> int:
    """Exact search in cells of growing distance; of equally near colours, the one with the smallest number.

    Cells that are farther away than the nearest colour so far are left out.

    Args:
        wanted: a colour, as a number.
        palette, starts: colours of the painting, as numbers, sorted by cell, and the first one of each cell.
    """
    r, g, b = wanted >> 16, wanted >> 8 & 255, wanted & 255
    cr, cg, cb = r // _CELL_LEVELS, g // _CELL_LEVELS, b // _CELL_LEVELS
    margin = min(min(r % _CELL_LEVELS, g % _CELL_LEVELS), b % _CELL_LEVELS)
    margin = min(margin, _CELL_LEVELS - 1 - max(max(r % _CELL_LEVELS, g % _CELL_LEVELS), b % _CELL_LEVELS))
    best, code = 1 << 30, 0
    for ring in range(_CELLS):
        outside = margin + 1 + (ring - 1) * _CELL_LEVELS
        if ring > 0 and best < outside * outside:
            break
        for x in range(max(cr - ring, 0), min(cr + ring, _CELLS - 1) + 1):
            far_x = _axis_distance(r, x) ** 2
            for y in range(max(cg - ring, 0), min(cg + ring, _CELLS - 1) + 1):
                far_xy = far_x + _axis_distance(g, y) ** 2
                if far_xy > best:
                    continue
                on_shell = max(abs(x - cr), abs(y - cg)) == ring
                step = 1 if on_shell or ring == 0 else 2 * ring
                for z in range(cb - ring, cb + ring + 1, step):
                    if z < 0 or z >= _CELLS or far_xy + _axis_distance(b, z) ** 2 > best:
                        continue
                    cell = (x * _CELLS + y) * _CELLS + z
                    for k in range(starts[cell], starts[cell + 1]):
                        dr = (palette[k] >> 16) - r
                        dg = (palette[k] >> 8 & 255) - g
                        db = (palette[k] & 255) - b
                        squared = dr * dr + dg * dg + db * db
                        if squared < best or (squared == best and palette[k] < code):
                            best, code = squared, palette[k]
    return code
