"""Places of the scene that are searched for faces first: what a camera motion brings into view, and what moves.

A search of a whole frame is spread over many frames, in which faces of a crowd that the camera pans over have left the
frame again, and somebody who walks in has crossed it. Two maps move with the flow, what has never been searched and
what has moved since it was searched, so that a rectangle there is searched first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Flow, Plane
from pipeline.kernels.jit import kernel
from pipeline.perception.flow.warp import positions, scale_flow
from pipeline.perception.motion import median_motion


class PlaceParams(NamedTuple):
    """Constants of the choice of places. Lengths are widths of the smallest face unless stated otherwise."""

    map_side: int = 64
    """Cells of the map on its longer side."""
    short: float = 4.0
    long: float = 10.0
    """Sides of a searched rectangle, in widths of the smallest face."""
    largest: float = 2.5
    """Width of the largest face that is searched there, relative to the smallest: larger ones are soon found
    without."""
    margin: float = 1.5
    """Faces of which a part may be outside the rectangle are this near its border, in widths of the smallest face."""
    least_share: float = 0.5
    """Mean of a map from which on a rectangle is searched: a strip of new cells that is wider than the smallest
    face."""
    slowest: float = 0.015
    """Speed relative to the camera from which on a cell moves, in widths of the smallest face a frame."""
    motion_gain: float = 0.2
    most_motion: float = 3.0
    """Value that `moving` gains per frame in a moving cell, and its largest value. It exceeds 1 because a person
    who walks covers only a part of a rectangle, whose mean must reach `least_share`."""
    motion_every_frames: int = 4
    """Least number of frames from one search of a moving place to the next: in a crowd, something moves all the
    time."""


PLACES = PlaceParams()


class Rectangle(NamedTuple):
    """Pixels [left, right) x [top, bottom) of a frame."""

    left: int
    top: int
    right: int
    bottom: int


class NewPlaces:
    """Two maps that choose the next rectangle of the frame to search for faces. Not thread-safe.

    Args:
        size: (width, height) of the frames, px.
        least_px: smallest face.

    Attributes:
        unsearched: float32 (h, w), a grid over the frame: 1 = never searched, 0 = searched.
        moving: float32 (h, w), the same grid: amount of motion since the latest search, 0..`PLACES.most_motion`.
    """

    def __init__(self, size: tuple[int, int], least_px: int) -> None:
        self._size, self._least_px = size, least_px
        scale = min(1.0, PLACES.map_side / max(size))
        self._cells = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
        self._shapes = self._rectangles()
        self.unsearched: Plane = np.zeros(self._cells[::-1], np.float32)
        self.moving: Plane = np.zeros(self._cells[::-1], np.float32)

    def clear(self) -> None:
        """The whole frame has been searched."""
        self.unsearched, self.moving = np.zeros_like(self.unsearched), np.zeros_like(self.moving)

    def restore(self, plane: AnyArray | None, moving: AnyArray | None) -> None:
        """Continue with the maps of another one, of any size; None = everything has been searched."""
        self.unsearched, self.moving = self._resampled(plane), self._resampled(moving)

    def _resampled(self, plane: AnyArray | None) -> Plane:
        if plane is None:
            return np.zeros(self._cells[::-1], np.float32)
        same = plane.shape == self.unsearched.shape
        now = plane if same else cv2.resize(plane, self._cells, interpolation=cv2.INTER_LINEAR)
        return np.array(now, np.float32)

    def move(self, flow: Flow) -> None:
        """Move the maps to the next frame.

        Args:
            flow: from the previous frame to this one, px of the frame, on a grid of any size.
        """
        coarse = np.asarray(cv2.resize(flow, self._cells, interpolation=cv2.INTER_LINEAR), np.float32)
        across, down = np.divide(self._cells, self._size)
        x, y = positions(scale_flow(coarse, -across, -down))
        new = cv2.remap(self.unsearched, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0)
        self.unsearched = np.asarray(new, np.float32)
        moved = cv2.remap(self.moving, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        self.moving = np.asarray(moved, np.float32)
        _add_motion(coarse, median_motion(coarse), np.float32((PLACES.slowest * self._least_px) ** 2), self.moving)

    def next_rectangle(self, age: int) -> Rectangle | None:
        """The rectangle with the largest mean of a map; None if it is less than `PLACES.least_share` in both.

        `age`: number of the search; moving places are searched in some of them.
        """
        new = self._largest(self.unsearched)
        return self._largest(self.moving) if new is None and age % PLACES.motion_every_frames == 0 else new

    def _largest(self, plane: Plane) -> Rectangle | None:
        best, found = PLACES.least_share, None
        for w, h in self._shapes:
            share, row, column = _fullest(plane, w, h)
            if share > best:
                best, found = share, self._in_px(column, row, w, h)
        return found

    def searched(self, where: Rectangle) -> None:
        """A rectangle has been searched. Near its border, faces may have been cut."""
        (across, down), (width, height) = np.divide(self._cells, self._size), self._cells
        left, right = round(where.left * across), round(where.right * across)
        top, bottom = round(where.top * down), round(where.bottom * down)
        near_x, near_y = (round(side) for side in self._in_cells((PLACES.margin, PLACES.margin)))
        inner_x = slice(left + near_x if left else 0, right - near_x if right < width else width)
        inner_y = slice(top + near_y if top else 0, bottom - near_y if bottom < height else height)
        for plane in (self.unsearched, self.moving):
            plane[top:bottom, left:right] *= np.float32(0.5)
            plane[inner_y, inner_x] = 0

    def newness(self, box: NDArray[np.float64]) -> float:
        """Largest value of the maps in a box (centre x, centre y, width, height), px: 0..1."""
        scale = np.divide(self._cells, self._size)
        (x0, y0), (x1, y1) = ((box[:2] + sign * box[2:] / 2) * scale for sign in (-1, 1))
        inside = slice(max(0, int(y0)), max(0, math.ceil(y1))), slice(max(0, int(x0)), max(0, math.ceil(x1)))
        return min(1.0, max(float(plane[inside].max(initial=0)) for plane in (self.unsearched, self.moving)))

    def _rectangles(self) -> list[tuple[int, int]]:
        """(width, height) in cells of an upright rectangle and of a lying one. Equal parts of the frame's side, with
        the margin, so that no remainder of a strip is too small to be searched."""
        (wide, high), (thin, low), near = (
            self._cells,
            self._in_cells((PLACES.short, PLACES.short)),
            self._in_cells((PLACES.margin, PLACES.margin)),
        )
        most = self._in_cells((PLACES.long, PLACES.long))
        across, down = (
            min(side, math.ceil(side / max(1, math.ceil((side - edge) / (part - edge))) + edge))
            for side, edge, part in zip(self._cells, near, most, strict=True)
        )
        return [(min(math.ceil(thin), wide), down), (across, min(math.ceil(low), high))]

    def _in_cells(self, sides: tuple[float, float]) -> tuple[float, float]:
        """Sides in widths of the smallest face, in cells."""
        return (
            sides[0] * self._least_px * self._cells[0] / self._size[0],
            sides[1] * self._least_px * self._cells[1] / self._size[1],
        )

    def _in_px(self, column: int, row: int, w: int, h: int) -> Rectangle:
        across, down = np.divide(self._size, self._cells)
        return Rectangle(
            round(column * across), round(row * down), round((column + w) * across), round((row + h) * down)
        )


@kernel
def _add_motion(flow: Flow, camera: NDArray[np.float32], slowest: np.float32, moving: Plane) -> None:
    """Add `PLACES.motion_gain` to the cells that move, up to `PLACES.most_motion`.

    Args:
        camera: motion of the camera; slowest: square of the least speed relative to it.
    """
    for row in range(moving.shape[0]):
        for column in range(moving.shape[1]):
            across, down = flow[row, column, 0] - camera[0], flow[row, column, 1] - camera[1]
            gain = np.float32(PLACES.motion_gain) if across * across + down * down > slowest else np.float32(0)
            moving[row, column] = min(moving[row, column] + gain, np.float32(PLACES.most_motion))


@kernel
def _fullest(plane: Plane, width: int, height: int) -> tuple[float, int, int]:
    """Largest mean of a rectangle of cells, rounded to six places, and the rectangle's first row and column: the first
    of equal ones."""
    rows, columns = plane.shape
    sums = np.zeros((rows + 1, columns + 1), np.float64)
    for y in range(rows):
        total = 0.0
        for x in range(columns):
            total += plane[y, x]
            sums[y + 1, x + 1] = sums[y, x + 1] + total
    best, at_row, at_column = -1.0, 0, 0
    for y in range(rows + 1 - height):
        for x in range(columns + 1 - width):
            total = sums[y + height, x + width] - sums[y, x + width] - sums[y + height, x] + sums[y, x]
            share = np.rint(total / (width * height) * 1e6) / 1e6
            if share > best:
                best, at_row, at_column = share, y, x
    return best, at_row, at_column
