"""Source of the paint of each pixel of the residual layer: the number of a frame, and a position in that frame.

Sources are advected by the flow instead of paint: paint that was warped again and again would blur.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Flow, Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.methods.patches.paint_error import Rendering
from pipeline.methods.patches.scan import WorkingGrid
from pipeline.perception.flow.warp import scale_flow

MIN_RELIABILITY = 0.02
"""Reliability, 0..1, from which a flow vector is valid. It is low because changes of colour are left to the misfit."""
MIN_INVALID_PX = 3
"""Areas of invalid flow narrower than this, working px, are treated as valid, like their surroundings."""
MAX_STRETCH = 1.0
"""Relative change of the distance between neighbours above which advected strokes count as distorted. Flow in areas
without texture is arbitrary and would distort them."""
NEIGHBOUR_PX = 4
"""Distance of those neighbours, px."""
REMAP_ROW = 512
"""Row length of the tables given to `cv2.remap`, which limits each side of an image to 32767."""
NO_SOURCE = -1
"""Frame number of a pixel without a source."""
_NOTHING: Rendering = np.empty(0, np.uint8), np.empty(0, np.uint8)

Positions = NDArray[np.float32]
"""float32 (h, w, 2): positions (x, y), px."""
Paintings = Mapping[int, Rendering]
"""Frame number -> source picture and its painting."""


@dataclass(frozen=True)
class PaintSource:
    """Source of each pixel's paint: a frame number and a position in that frame.

    Attributes:
        frame: int32 (h, w), number of the source frame, or NO_SOURCE.
        position: float32 (h, w, 2), position (x, y) in the source frame, px.
    """

    frame: NDArray[np.int32]
    position: Positions

    @classmethod
    def identity(cls, index: int, shape: tuple[int, ...]) -> PaintSource:
        """Every pixel comes from frame `index`, at its own position."""
        out = cls(np.empty(shape[:2], np.int32), np.empty((*shape[:2], 2), np.float32))
        _reset(index, np.ones(shape[:2], np.bool_), out.frame, out.position)
        return out

    def advect(self, pair: tuple[Flow, Plane] | None, grid: WorkingGrid, where: Mask) -> PaintSource:
        """Advect the sources to the frame in which `pair` starts.

        Args:
            pair: flow, working px, from the new frame to this one and its reliability; None = no valid flow.
            where: bool (h, w), pixels to compute; all others get NO_SOURCE.
        """
        out = PaintSource(np.full_like(self.frame, NO_SOURCE), np.zeros_like(self.position))
        if pair is not None:
            flow = scale_flow(np.asarray(grid.upscale(pair[0]), np.float32), *grid.ratio)
            valid = np.asarray(grid.upscale(valid_flow(pair[1]).astype(np.float32)), np.float32)
            _advect(self.frame, self.position, flow, where, valid, out.frame, out.position)
        return out

    def reset(self, index: int, where: Mask) -> PaintSource:
        """Replace the source of the pixels in `where` by frame `index`, at their own positions."""
        out = PaintSource(self.frame.copy(), self.position.copy())
        _reset(index, where, out.frame, out.position)
        return out

    def sample(self, paintings: Paintings, where: Mask) -> Rendering:
        """Sample the source pictures and their paintings at the stored positions.

        Pixels outside `where` are 0.
        """
        out = tuple(np.zeros((*where.shape, 3), each.dtype) for each in next(iter(paintings.values()), _NOTHING))
        first, last = min(paintings, default=0), max(paintings, default=0)
        pixels, positions = np.empty(where.size, np.int32), np.empty((where.size, 2), np.float32)
        bounds = np.zeros(last - first + 2, np.int64)
        _group(self.frame, self.position, where, first, bounds, pixels, positions)
        for source, (start, stop) in enumerate(pairwise(bounds.tolist()), start=first):
            if stop > start:
                for which, plane in enumerate(out):
                    found = _sampled(paintings[source][which], positions[start:stop], bicubic=which == 1)
                    _scatter(found, pixels[start:stop], plane)
        return out[0], out[1]

    def frames(self) -> list[int]:
        """Sorted numbers of the source frames."""
        if not self.frame.size:
            return []
        first, last = int(self.frame.min()), int(self.frame.max())
        flags = np.zeros(last - first + 1, np.bool_)
        _flag(self.frame, first, flags)
        return (np.flatnonzero(flags) + first).tolist()

    def clear_distorted(self, where: Mask) -> None:
        """Clear pixels of `where`, in place, whose distance to a neighbour of the same source frame has changed too
        much: by more than `MAX_STRETCH` times the distance `NEIGHBOUR_PX`."""
        _clear_distorted(self.frame, self.position, where)


def valid_flow(reliable: Plane) -> Mask:
    """Mask of valid flow, bool (h, w); invalid areas narrower than `MIN_INVALID_PX` count as valid."""
    invalid = (reliable < MIN_RELIABILITY).astype(np.uint8)
    square = np.ones((MIN_INVALID_PX, MIN_INVALID_PX), np.uint8)
    return np.asarray(cv2.morphologyEx(invalid, cv2.MORPH_OPEN, square) == 0)


@kernel
def _flag(frames: NDArray[np.int32], first: int, flags: Mask) -> None:
    height, width = frames.shape
    for y in range(height):
        for x in range(width):
            flags[frames[y, x] - first] = True


def _sampled(picture: AnyArray, positions: Positions, *, bicubic: bool) -> AnyArray:
    """Sample a picture at float32 (n, 2) positions: (n, 3). Bilinear unless `bicubic`."""
    rows = -(-len(positions) // REMAP_ROW)
    table = np.empty((2, rows * REMAP_ROW), np.float32)
    table[:, : len(positions)] = positions.T
    table[:, len(positions) :] = 0
    x, y = table.reshape(2, rows, REMAP_ROW)
    interpolation = cv2.INTER_CUBIC if bicubic else cv2.INTER_LINEAR
    found = cv2.remap(picture, x, y, interpolation, borderMode=cv2.BORDER_REPLICATE)
    return found.reshape(-1, 3)[: len(positions)]


@kernel
def _reset(index: int, where: Mask, frames: NDArray[np.int32], position: Positions) -> None:
    height, width = where.shape
    for y in range(height):
        for x in range(width):
            if where[y, x]:
                frames[y, x] = index
                position[y, x, 0], position[y, x, 1] = x, y


@kernel
def _group(
    frames: NDArray[np.int32], position: Positions, where: Mask, first: int, bounds: NDArray[np.int64],
    pixels: NDArray[np.int32], positions: Positions,
) -> None:  # fmt: skip
    """Sort the pixels of `where` by source frame: their flat indices and positions.

    Args:
        first: number of the first source frame.
        bounds: zeros; where the pixels of each source frame begin, and where the last ones end.
    """
    height, width = where.shape
    used = np.zeros(len(bounds), np.int64)
    for y in range(height):
        for x in range(width):
            if where[y, x]:
                used[frames[y, x] - first] += 1
    for k in range(len(bounds) - 1):
        bounds[k + 1] = bounds[k] + used[k]
        used[k] = bounds[k]
    for y in range(height):
        for x in range(width):
            if where[y, x]:
                at = used[frames[y, x] - first]
                used[frames[y, x] - first] = at + 1
                pixels[at] = y * width + x
                positions[at, 0], positions[at, 1] = position[y, x, 0], position[y, x, 1]


@kernel
def _scatter(colours: AnyArray, pixels: NDArray[np.int32], out: AnyArray) -> None:
    width = out.shape[1]
    for k in range(len(pixels)):
        y, x = pixels[k] // width, pixels[k] % width
        out[y, x, 0], out[y, x, 1], out[y, x, 2] = colours[k, 0], colours[k, 1], colours[k, 2]


@kernel
def _advect(
    frames: NDArray[np.int32],
    position: Positions,
    flow: Flow,
    where: Mask,
    valid: Plane,
    out: NDArray[np.int32],
    out_position: Positions,
) -> None:
    """Sample source frame and position at the flow's target, where the flow is `valid` by more than half.

    The source frame is that of the nearest pixel; the position is interpolated among those of the four surrounding
    pixels that have the same source frame.
    """
    height, width = where.shape
    for y in range(height):
        for x in range(width):
            if not where[y, x] or not valid[y, x] > np.float32(0.5):
                continue
            u = min(max(np.float32(x) + flow[y, x, 0], np.float32(0)), np.float32(width - 1))
            v = min(max(np.float32(y) + flow[y, x, 1], np.float32(0)), np.float32(height - 1))
            source = frames[int(v + np.float32(0.5)), int(u + np.float32(0.5))]
            if source < 0:
                continue
            column, row = min(int(u), max(width - 2, 0)), min(int(v), max(height - 2, 0))
            a, b = u - np.float32(column), v - np.float32(row)
            total, at_x, at_y = np.float32(0), np.float32(0), np.float32(0)
            for corner in range(4):
                r, c = min(row + corner // 2, height - 1), min(column + corner % 2, width - 1)
                if frames[r, c] == source:
                    weight = (b if corner >= 2 else np.float32(1) - b) * (a if corner % 2 else np.float32(1) - a)
                    total += weight
                    at_x += weight * (position[r, c, 0] - np.float32(c) + u)
                    at_y += weight * (position[r, c, 1] - np.float32(r) + v)
            out[y, x] = source
            out_position[y, x, 0], out_position[y, x, 1] = at_x / total, at_y / total


@kernel
def _clear_distorted(frames: NDArray[np.int32], position: Positions, where: Mask) -> None:
    height, width = where.shape
    most = np.float32(MAX_STRETCH * NEIGHBOUR_PX)
    for y in range(height):
        for x in range(width):
            if not where[y, x]:
                continue
            for axis in range(2):
                r, c = y + (NEIGHBOUR_PX if axis else 0), x + (0 if axis else NEIGHBOUR_PX)
                if r >= height or c >= width or frames[r, c] != frames[y, x]:
                    r, c = y - (NEIGHBOUR_PX if axis else 0), x - (0 if axis else NEIGHBOUR_PX)
                if r < 0 or c < 0 or frames[r, c] != frames[y, x]:
                    continue
                along = abs(position[r, c, 0] - position[y, x, 0] - np.float32(c - x))
                across = abs(position[r, c, 1] - position[y, x, 1] - np.float32(r - y))
                where[y, x] = where[y, x] and max(along, across) <= most
