"""Stroke seeds: a jittered grid whose density follows the stroke size, and whose seeds have stable ids.

The grid is nested: each cell has a rank by Bayer's ordered dither, so the cells up to any rank are evenly spread and
larger strokes use a subset of the cells of smaller ones. When the size changes slowly over space or time, single seeds
appear or vanish and the others keep their place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.random import Ids, Purpose, philox

Points: TypeAlias = NDArray[np.float32]
"""Positions in px, `float32` (n, 2): (x, y)."""

StyleField: TypeAlias = float | Plane
"""A style parameter: one number for the whole picture, or one per pixel, or one per cell of a coarser grid over it."""

_LEVELS = 4
"""Levels of Bayer's matrix: spacings of one picture may differ by a factor of 2 to this power."""

_UNIT = 2.0**-32


@dataclass(frozen=True)
class Seeds:
    """Starting points of strokes: `xy` float32 (n, 2) in px, inside the picture, and their `ids` uint64 (n,)."""

    xy: Points
    ids: Ids

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Seeds:
        kept = np.flatnonzero(keep) if keep.dtype == np.bool_ else keep
        return Seeds(self.xy.take(kept, axis=0), self.ids.take(kept))


def as_plane(field: StyleField, shape: tuple[int, ...]) -> Plane:
    """Expand the field to float32 (h, w), C-contiguous.

    Raises:
        BadParameter: the field has another shape than the picture, or is not finite.
    """
    plane = np.asarray(field, np.float32)
    if plane.ndim and plane.shape != tuple(shape[:2]):
        raise BadParameter(
            "A style field must have one value, or one per pixel.",
            field="style", value=plane.shape, remedy=f"Give it the shape {tuple(shape[:2])}.",
        )  # fmt: skip
    if not np.isfinite(plane).all():
        raise BadParameter(
            "A style field must be finite.", field="style", value="nan or inf", remedy="Use finite values."
        )
    return np.ascontiguousarray(np.broadcast_to(plane, shape[:2]))


def sample(field: StyleField, xy: Points, shape: tuple[int, ...] | None = None) -> NDArray[np.float32]:
    """Read the field at each point: float32 (n,). A plane is read at the nearest pixel, a coarser grid is interpolated.

    Args:
        shape: (height, width, ...) of the picture in whose px the points are given; None = that of the field.
    """
    return sample_all([field], xy, np.shape(field) if shape is None else shape)[0]


def sample_all(fields: Sequence[StyleField], xy: Points, shape: tuple[int, ...]) -> list[NDArray[np.float32]]:
    """`sample` for many fields at the same points, whose pixels or cells are found once."""
    planes = [np.asarray(field, np.float32) for field in fields]
    coarser = [plane for plane in planes if plane.ndim and plane.shape != tuple(shape[:2])]
    between = iter(_between_cells(coarser, xy, shape))
    pixels: NDArray[np.intp] | None = None
    found = []
    for plane in planes:
        if plane.ndim == 0:
            found.append(np.full(len(xy), plane, np.float32))
        elif plane.shape != tuple(shape[:2]):
            found.append(next(between))
        else:
            if pixels is None:
                x, y = nearest(xy, shape)
                pixels = y * shape[1] + x
            found.append(plane.reshape(-1).take(pixels))
    return found


def _between_cells(planes: Sequence[Plane], xy: Points, shape: tuple[int, ...]) -> list[NDArray[np.float32]]:
    """Values of coarser grids, interpolated at points; grids of one size at once."""
    if len({plane.shape for plane in planes}) != 1 or len(planes) == 1:
        return [interpolated(plane[..., None], xy, shape)[:, 0] for plane in planes]
    grids, out = np.stack(planes), np.empty((len(planes), len(xy)), np.float32)
    scale = np.float32(grids.shape[2] / shape[1]), np.float32(grids.shape[1] / shape[0])
    _interpolate_planes(grids, xy, scale, out)
    return list(out)


@kernel
def _interpolate_planes(
    grids: NDArray[np.float32], xy: Points, scale: tuple[np.float32, np.float32], out: NDArray[np.float32]
) -> None:
    """`_interpolate` for grids one after the other."""
    count, rows, columns = grids.shape
    half, values, places = np.float32(0.5), grids.reshape(-1), xy.reshape(-1)
    for k in range(len(xy)):
        x, y = places[np.uintp(2 * k)], places[np.uintp(2 * k + 1)]
        x = min(max((x + half) * scale[0] - half, np.float32(0)), np.float32(columns - 1))
        y = min(max((y + half) * scale[1] - half, np.float32(0)), np.float32(rows - 1))
        left, top = int(x), int(y)
        right, bottom = min(left + 1, columns - 1), min(top + 1, rows - 1)
        a, b = x - np.float32(left), y - np.float32(top)
        upper, lower = top * columns, bottom * columns
        for c in range(count):
            above, below = values[np.uintp(upper + left)], values[np.uintp(lower + left)]
            above += a * (values[np.uintp(upper + right)] - above)
            below += a * (values[np.uintp(lower + right)] - below)
            out[c, k] = above + b * (below - above)
            upper, lower = upper + rows * columns, lower + rows * columns


def interpolated(grid: AnyArray, xy: Points, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Values of a coarser grid over a picture of `shape`, interpolated bilinearly at points: float32 (n, channels).

    Args:
        grid: (rows, columns, channels), uint8 or float32.
        xy: px of the picture.
    """
    out = np.empty((len(xy), grid.shape[2]), np.float32)
    values = np.asarray(grid, np.float32)  # the kernel is compiled for one type
    _interpolate(values, xy, (np.float32(grid.shape[1] / shape[1]), np.float32(grid.shape[0] / shape[0])), out)
    return out


@kernel
def _interpolate(
    grid: NDArray[np.float32], xy: Points, scale: tuple[np.float32, np.float32], out: NDArray[np.float32]
) -> None:
    rows, columns, channels = grid.shape
    half = np.float32(0.5)
    for k in range(len(xy)):
        x = min(max((xy[k, 0] + half) * scale[0] - half, np.float32(0)), np.float32(columns - 1))
        y = min(max((xy[k, 1] + half) * scale[1] - half, np.float32(0)), np.float32(rows - 1))
        left, top = int(x), int(y)
        right, bottom = min(left + 1, columns - 1), min(top + 1, rows - 1)
        a, b = x - np.float32(left), y - np.float32(top)
        for c in range(channels):
            above, below = grid[top, left, c], grid[bottom, left, c]
            above += a * (grid[top, right, c] - above)
            below += a * (grid[bottom, right, c] - below)
            out[k, c] = above + b * (below - above)


def nearest(
    xy: Points, grid: tuple[int, ...], shape: tuple[int, ...] | None = None
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Column and row of the pixel nearest to each point, clamped to the picture.

    Args:
        grid: (rows, columns, ...) of the array to be read: the picture, or a coarser grid over all of it.
        shape: (height, width, ...) of the picture in whose px the points are given; None = `grid`.
    """
    rows, columns = grid[:2]
    height, width = grid[:2] if shape is None else shape[:2]
    x, y = np.empty(len(xy), np.intp), np.empty(len(xy), np.intp)
    _nearest(xy, (rows, columns), (np.float32(columns / width), np.float32(rows / height)), x, y)
    return x, y


@kernel
def _nearest(
    xy: Points, grid: tuple[int, int], scale: tuple[np.float32, np.float32], x: NDArray[np.intp], y: NDArray[np.intp]
) -> None:
    rows, columns = grid
    for k in range(len(xy)):
        x[k] = min(max(int(np.floor((xy[k, 0] + np.float32(0.5)) * scale[0])), 0), columns - 1)
        y[k] = min(max(int(np.floor((xy[k, 1] + np.float32(0.5)) * scale[1])), 0), rows - 1)


class Grid(NamedTuple):
    """Cells of the jittered grid, and the part of the picture for which spacings are given.

    Attributes:
        cell_px: side of a cell, px.
        rows, columns: cells [start, stop) that may have their centres in that part.
        corner, size: first row and column, and number of rows and columns of that part, px.
    """

    cell_px: float
    rows: tuple[int, int]
    columns: tuple[int, int]
    corner: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def of(cls, cell_px: float, shape: tuple[int, ...], part: tuple[int, int, int, int]) -> Grid:
        """Args: shape: (height, width, ...) of the picture; part: first row and column, number of rows and columns."""
        top, left, height, width = part
        spans = []
        for start, length, whole in ((top, height, shape[0]), (left, width, shape[1])):
            stop = math.ceil(whole / cell_px) if start + length >= whole else math.ceil((start + length) / cell_px)
            spans.append((max(int(start / cell_px) - 1, 0), stop))
        return cls(cell_px, spans[0], spans[1], (top, left), (height, width))


def place(
    shape: tuple[int, ...], spacing_px: StyleField, *, jitter: float = 1.0, seed: int = 0, layer: int = 0,
    birth: int = 0, corner: tuple[int, int] | None = None,
) -> Seeds:  # fmt: skip
    """Place seeds about `spacing_px` apart; without jitter no place is further than twice that from a seed.

    Args:
        shape: (height, width, ...) of the picture.
        spacing_px: distance of neighbours, > 0; values below a sixteenth of the maximum count as that sixteenth. One
            number, or float32, a grid of any size over the picture.
        jitter: 0 = on the grid, 1 = anywhere within a square of side `spacing_px` about the grid point.
        seed, layer: random seed, and number of the layer; each layer has its own jitter.
        birth: frame that the seeds are made for; it is a part of their ids and does not change their places.
        corner: row and column of the picture at which `spacing_px`, then one value a px, begins; only seeds whose cells
            have their centres in that part are placed. None = it covers the whole picture.

    Source: kagaya2011video, section 4.1 (jittered grid). Departure: the density follows the stroke size. The paper
    keeps one density for all styles because a change of density made strokes jump; nested grids avoid the jumps.
    """
    spacing = np.atleast_2d(np.asarray(spacing_px, np.float32))
    spacing = as_plane(spacing, spacing.shape)
    if spacing.min(initial=1.0) <= 0:
        raise BadParameter(
            "Strokes need a spacing above 0.", field="size_px", value=float(spacing.min()), remedy="Use a size above 0."
        )
    cell = 2.0 ** math.floor(math.log2(max(float(spacing.min()), float(spacing.max()) / 2**_LEVELS)))
    part = (0, 0, shape[0], shape[1]) if corner is None else (*corner, *spacing.shape)
    grid = Grid.of(cell, shape, part)
    most = (grid.rows[1] - grid.rows[0]) * (grid.columns[1] - grid.columns[0])
    xy, ids = np.empty((most, 2), np.float32), np.empty(most, np.uint64)
    key, origin = (seed & 0xFFFFFFFF, int(Purpose.PLACE)), (layer, birth & 0xFFFFFF)
    n = _place(spacing, (shape[0], shape[1]), grid, jitter, key, origin, xy, ids)
    return Seeds(xy[:n].copy(), ids[:n].copy())


@kernel
def _place(
    spacing: Plane, shape: tuple[int, int], grid: Grid, jitter: float, key: tuple[int, int], origin: tuple[int, int],
    xy: Points, ids: Ids,
) -> int:  # fmt: skip
    """Fill `xy` and `ids`; return the number of seeds. `shape` is (height, width), `origin` (layer, birth)."""
    height, width = shape
    rows, columns = spacing.shape
    cell = grid.cell_px
    layer, birth = origin
    n = 0
    # The cell size is a part of the counter, so another grid gives other ids; quarter pixels distinguish all sizes.
    salt = (layer & 0xFF) | (int(cell * 64.0) << 8)
    columns_at = np.empty(grid.columns[1], np.intp)
    for j in range(grid.columns[1]):
        columns_at[j] = (min(int((j + 0.5) * cell), width - 1) - grid.corner[1]) * columns // grid.size[1]
    ranks = np.zeros((1 << _LEVELS, 1 << _LEVELS), np.int64)
    for i in range(1 << _LEVELS):
        for j in range(1 << _LEVELS):
            for k in range(_LEVELS):
                a, b = (j >> k) & 1, (i >> k) & 1
                ranks[i, j] = ranks[i, j] * 4 + ((a ^ b) * 2 + b)
    for i in range(grid.rows[0], grid.rows[1]):
        row = (min(int((i + 0.5) * cell), height - 1) - grid.corner[0]) * rows // grid.size[0]
        if row < 0 or row >= rows:
            continue
        spacings = spacing[row]
        for j in range(grid.columns[0], grid.columns[1]):
            if columns_at[j] < 0 or columns_at[j] >= columns:
                continue
            x, y = (j + 0.5) * cell - 0.5, (i + 0.5) * cell - 0.5
            step = max(np.float64(spacings[columns_at[j]]), cell)
            rank = ranks[i & ((1 << _LEVELS) - 1), j & ((1 << _LEVELS) - 1)]
            if rank / 4.0**_LEVELS * step * step >= cell * cell:
                continue  # no random number can bring the rank below the limit
            words = philox(j, i, salt, 0, key[0], key[1])
            rank_unit = (rank + words[2] * _UNIT) / 4.0**_LEVELS
            if rank_unit * step * step >= cell * cell:
                continue
            x += (words[0] * _UNIT - 0.5) * jitter * step
            y += (words[1] * _UNIT - 0.5) * jitter * step
            xy[n, 0] = min(max(x, 0.0), width - 1.0)
            xy[n, 1] = min(max(y, 0.0), height - 1.0)
            base = (np.uint64(layer & 0xF) << np.uint64(60)) | (np.uint64(birth) << np.uint64(36))
            ids[n] = base | (np.uint64(i & 0x3FFFF) << np.uint64(18)) | np.uint64(j & 0x3FFFF)
            n += 1
    return n
