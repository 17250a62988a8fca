"""The picture of a layer as its strokes need it, computed only around the pixels in which strokes may start.

The residual layer of a frame is often scattered over the whole frame and yet covers a small part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask, Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.brush import Brush, Direction
from pipeline.strokes.raster import slopes_of
from pipeline.tensors.structure import doubled_tangents

LEAST_PAD_PX = 8
"""Pixels around the strokes of the finest brush for which blur, steepening and directions are computed."""
CELL_PX = 8
"""Side of the cells in which connected areas are found, px."""
MOST_SHARE = 0.8
"""Share of the picture in several areas, above which the whole picture is computed instead."""

Box = tuple[slice, slice]
"""Rows and columns."""


@dataclass(frozen=True)
class LayerPicture:
    """Picture and directions that the strokes of a layer follow.

    Attributes:
        reference: uint8 (h, w, 3), the blurred picture of the layer.
        field: float32 (h, w, 2), stroke directions, see `directions`.
        slopes: float32 (h, w), see `slopes_of`.
    """

    reference: Frame
    field: Direction
    slopes: Plane

    @classmethod
    def of(cls, reference: Frame, brush: Brush) -> LayerPicture:
        """Everything of a reference picture."""
        return cls(reference, directions(reference, brush), slopes_of(reference))

    @classmethod
    def within(
        cls, areas: Sequence[Box], base: Frame, brush: Brush, make_reference: Callable[[Box], Frame]
    ) -> LayerPicture:
        """The same in some areas only. Elsewhere the reference is `base`, and strokes go straight on.

        Args:
            base: uint8 (h, w, 3).
            make_reference: makes the reference picture of an area.
        """
        height, width = base.shape[:2]
        reference, slopes = base.copy(), np.zeros((height, width), np.float32)
        field = np.zeros((height, width, 2), np.float32)
        for area in areas:
            own = cls.of(make_reference(area), brush)
            reference[area], field[area], slopes[area] = own.reference, own.field, own.slopes
        return cls(reference, field, slopes)


def directions(reference: Frame, brush: Brush) -> Direction:
    """Stroke directions normal to the image gradient: float32 (h, w, 2), (cos 2a, sin 2a) times a length of 0..1.

    Departures from hertzmann1998painterly: the gradient is averaged over the stroke's width by a structure tensor,
    since the gradient of a single pixel is mostly noise in smooth areas; and it is that of the colours, not of the
    lightness, so that strokes do not cross an edge between colours of equal lightness.
    """
    return doubled_tangents(reference, max(float(np.median(brush.size_px)) / 2, 1.0))


def areas_around(where: Mask, pad_px: int) -> list[Box]:
    """Disjoint rectangles that contain every pixel within `pad_px` of a mask, bool (h, w), or the whole picture.

    Each rectangle surrounds one or several connected areas of the mask.
    """
    height, width = where.shape
    cells = np.zeros((-(-height // CELL_PX), -(-width // CELL_PX)), np.uint8)
    _mark_cells(where, cells)
    if cells.all():
        return [(slice(0, height), slice(0, width))]
    _, _, stats, _ = cv2.connectedComponentsWithStats(cells, connectivity=8, ltype=cv2.CV_32S)
    found: list[tuple[int, int, int, int]] = []
    for left, top, across, down in (stats[1:, :4] * CELL_PX).tolist():
        low = max(top - pad_px, 0), max(left - pad_px, 0)
        found = _merged(found, (*low, min(top + down + pad_px, height), min(left + across + pad_px, width)))
    if sum((bottom - top) * (right - left) for top, left, bottom, right in found) > MOST_SHARE * where.size:
        return [(slice(0, height), slice(0, width))]
    return [(slice(top, bottom), slice(left, right)) for top, left, bottom, right in found]


@kernel
def _mark_cells(where: Mask, cells: NDArray[np.uint8]) -> None:
    for y in range(where.shape[0]):
        for x in range(where.shape[1]):
            if where[y, x]:
                cells[y // CELL_PX, x // CELL_PX] = 1


def _merged(boxes: list[tuple[int, int, int, int]], more: tuple[int, int, int, int]) -> list[tuple[int, int, int, int]]:
    """Disjoint rectangles (top, left, bottom, right) and another one, which is united with those that it meets."""
    apart = []
    for box in boxes:
        if box[0] < more[2] and more[0] < box[2] and box[1] < more[3] and more[1] < box[3]:
            more = min(box[0], more[0]), min(box[1], more[1]), max(box[2], more[2]), max(box[3], more[3])
        else:
            apart.append(box)
    return [*apart, more] if len(apart) == len(boxes) else _merged(apart, more)
