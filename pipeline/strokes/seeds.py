"""Where strokes start: a jittered grid whose density follows the size of the strokes, and whose seeds have names.

The grid is the same at every size. A cell has a rank by Bayer's ordered dither, so the cells up to any rank are spread
evenly; larger strokes use fewer of them. As a size grows slowly, over the picture or over time, seeds drop out one by
one and the others stay where they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Plane
from pipeline.segmentation.jit import kernel
from pipeline.strokes.random import Ids, Purpose, philox

Points: TypeAlias = NDArray[np.float32]
"""Positions in px, `float32` (n, 2): (x, y)."""

Field: TypeAlias = float | Plane
"""A number for the whole picture, or one per pixel."""

_LEVELS = 4
"""Halvings that Bayer's ranks know: strokes of one picture may differ 16-fold in size before the smallest repeat."""

_UNIT = 2.0**-32


@dataclass(frozen=True)
class Seeds:
    """Starting points of strokes: `xy` float32 (n, 2) in px, inside the picture, and their names `ids` uint64 (n,)."""

    xy: Points
    ids: Ids

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Seeds:
        return Seeds(np.ascontiguousarray(self.xy[keep]), self.ids[keep])


def as_plane(field: Field, shape: tuple[int, ...]) -> Plane:
    """The field as float32 (h, w), C-contiguous.

    Raises:
        BadParameter: it has another shape, or is not finite.
    """
    plane = np.asarray(field, np.float32)
    if plane.ndim and plane.shape != tuple(shape[:2]):
        raise BadParameter(
            "A style field has one value, or one per pixel.",
            field="style", value=plane.shape, remedy=f"Give it the shape {tuple(shape[:2])}.",
        )  # fmt: skip
    if not np.isfinite(plane).all():
        raise BadParameter("A style field has finite values.", field="style", value="nan or inf", remedy="Fill it in.")
    return np.ascontiguousarray(np.broadcast_to(plane, shape[:2]))


def sample(field: Field, xy: Points) -> NDArray[np.float32]:
    """The field's value in the pixel that each point lies in, float32 (n,)."""
    plane = np.asarray(field, np.float32)
    if plane.ndim == 0:
        return np.full(len(xy), plane, np.float32)
    x, y = nearest(xy, plane.shape)
    return np.ascontiguousarray(plane[y, x])


def nearest(xy: Points, shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Column and row of the pixel each point lies in; points outside take the border's."""
    x = np.clip(np.floor(xy[:, 0] + 0.5), 0, shape[1] - 1).astype(np.intp)
    y = np.clip(np.floor(xy[:, 1] + 0.5), 0, shape[0] - 1).astype(np.intp)
    return x, y


def place(
    shape: tuple[int, ...], spacing_px: Field, *, jitter: float = 1.0, seed: int = 0, layer: int = 0, birth: int = 0
) -> Seeds:
    """Seeds about `spacing_px` apart, nowhere further than twice that (without jitter).

    Args:
        shape: (height, width, ...) of the picture.
        spacing_px: distance of neighbours, > 0; where it is below a sixteenth of its maximum, that sixteenth.
        jitter: 0 = on the grid, 1 = anywhere within a square of side `spacing_px` about it.
        seed, layer: whose numbers: each layer has its own jitter.
        birth: the frame that the seeds are for, a part of their names, not of their places.

    Source: kagaya2011video, section 4.1 (jittered grid). Departure: density follows the size; the paper keeps one
    density for all styles since it saw jumps, which Bayer's nested grids do not have.
    """
    spacing = as_plane(spacing_px, shape)
    if spacing.min(initial=1.0) <= 0:
        raise BadParameter("Strokes need a spacing above 0.", field="size_px", value=float(spacing.min()))
    cell = 2.0 ** math.floor(math.log2(max(float(spacing.min()), float(spacing.max()) / 2**_LEVELS)))
    rows, columns = (math.ceil(side / cell) for side in shape[:2])
    xy, ids = np.empty((rows * columns, 2), np.float32), np.empty(rows * columns, np.uint64)
    n = _place(
        spacing, cell, jitter, (seed & 0xFFFFFFFF, int(Purpose.PLACE)), layer, birth & 0xFFFFFF, rows, columns, xy, ids
    )
    return Seeds(xy[:n].copy(), ids[:n].copy())


@kernel
def _place(
    spacing: Plane, cell: float, jitter: float, key: tuple[int, int], layer: int, birth: int, rows: int, columns: int,
    xy: Points, ids: Ids,
) -> int:  # fmt: skip
    height, width = spacing.shape
    n = 0
    # The cell's size is in the counter, so a change of grid is a change of names; quarter pixels tell all sizes apart.
    grid = (layer & 0xFF) | (int(cell * 64.0) << 8)
    for i in range(rows):
        for j in range(columns):
            x, y = (j + 0.5) * cell - 0.5, (i + 0.5) * cell - 0.5
            px, py = min(int(x + 0.5), width - 1), min(int(y + 0.5), height - 1)
            step = max(np.float64(spacing[py, px]), cell)
            rank = 0
            for k in range(_LEVELS):
                a, b = (j >> k) & 1, (i >> k) & 1
                rank = rank * 4 + ((a ^ b) * 2 + b)
            if rank / 4.0**_LEVELS * step * step >= cell * cell:
                continue  # whatever it draws
            words = philox(j, i, grid, 0, key[0], key[1])
            rank_unit = (rank + words[2] * _UNIT) / 4.0**_LEVELS
            if rank_unit * step * step >= cell * cell:
                continue
            x += (words[0] * _UNIT - 0.5) * jitter * step
            y += (words[1] * _UNIT - 0.5) * jitter * step
            xy[n, 0] = min(max(x, 0.0), width - 1.0)
            xy[n, 1] = min(max(y, 0.0), height - 1.0)
            name = (np.uint64(layer & 0xF) << np.uint64(60)) | (np.uint64(birth) << np.uint64(36))
            ids[n] = name | (np.uint64(i & 0x3FFFF) << np.uint64(18)) | np.uint64(j & 0x3FFFF)
            n += 1
    return n
