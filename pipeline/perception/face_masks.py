"""Soft masks of faces: whole heads, and brows, eyes, nose and mouth, in a picture of any size."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.perception.faces import Faces


class FaceShape(NamedTuple):
    """Constants of the masks of faces. Lengths are sides of the detected box unless stated otherwise."""

    half_width: float = 0.55
    half_height: float = 0.75
    raised: float = 0.1
    """Semi-axes of the head's ellipse and its upward shift, in sides of the detected box, which ends at brows and
    chin."""
    least_cells: float = 1.5
    """Smallest semi-axis, in cells of the mask's grid: the mask of a small face would otherwise fall between them."""
    small_face: float = 0.2
    large_face: float = 0.4
    """Widths of a face, in shorter sides of the frame, between which the weight of `small_faces` falls from 1 to 0."""
    fade: float = 1.5
    """The mask falls from 1 at the head's ellipse to 0 at an ellipse this many times larger."""
    features_width: float = 0.36
    features_height: float = 0.405
    features_fade: float = 1.4
    """Semi-axes of the ellipse around brows, eyes, nose and mouth, in sides of the detected box, and its fade."""
    eye_apart: float = 0.2
    eye_raise: float = 0.14
    eye_width: float = 0.15
    eye_height: float = 0.11
    """Distance from the middle of the detected box to the middle of an eye and its brow, to the side and upwards, and
    semi-axes of the ellipse around both, in sides of the box."""


FACE_SHAPE = FaceShape()


class FaceCrop(NamedTuple):
    """A face in a picture.

    Attributes:
        box: rows and columns of the picture.
        weight: float32, 0..1, of the shape of `box`: by how much the pixels belong to the face, times its
            strength and a factor, see `face_crops`.
        face: centre x, centre y, width and height of the detected box, px of the picture.
    """

    box: tuple[slice, slice]
    weight: Plane
    face: tuple[float, float, float, float]

    @property
    def width_px(self) -> float:
        return self.face[2]

    def features(self) -> Plane:
        """`weight` where brows, eyes, nose and mouth are, and 0 on the outline of the head: float32, of its shape."""
        cx, cy, w, h = self.face
        return self.weight * _soft_ellipse(
            self.box,
            (cx, cy),
            (w * FACE_SHAPE.features_width, h * FACE_SHAPE.features_height),
            FACE_SHAPE.features_fade,
        )

    def eyes(self) -> Plane:
        """`weight` where the eyes and brows of a frontal face are: float32, of its shape."""
        cx, cy, w, h = self.face
        semi_axes = w * FACE_SHAPE.eye_width, h * FACE_SHAPE.eye_height
        left, right = (
            _soft_ellipse(
                self.box,
                (cx + side * w * FACE_SHAPE.eye_apart, cy - h * FACE_SHAPE.eye_raise),
                semi_axes,
                FACE_SHAPE.fade,
            )
            for side in (-1, 1)
        )
        return self.weight * np.maximum(left, right)

    def blend(self, plane: NDArray[np.uint8], other: NDArray[np.uint8]) -> None:
        """Move that part of a plane, uint8 (h, w), towards `other`, of the shape of `box`, by the weight."""
        _blend(plane[self.box], other, self.weight)


@kernel
def _blend(own: NDArray[np.uint8], other: NDArray[np.uint8], weight: Plane) -> None:
    for y in range(own.shape[0]):
        for x in range(own.shape[1]):
            mine = np.float32(own[y, x])
            own[y, x] = np.uint8(np.rint(mine + weight[y, x] * (np.float32(other[y, x]) - mine)))


def largeness(faces: Faces, size: tuple[int, int]) -> NDArray[np.float64]:
    """0 up to a width of `FACE_SHAPE.small_face`, rising to 1 at `FACE_SHAPE.large_face`: float64 (n,).

    Args:
        size: (width, height) of the frame, in whose px the faces are.
    """
    shares = faces["box"][:, 2] / min(size)
    return np.asarray(
        np.clip((shares - FACE_SHAPE.small_face) / (FACE_SHAPE.large_face - FACE_SHAPE.small_face), 0, 1), np.float64
    )


def small_faces(faces: Faces, size: tuple[int, int], picture: tuple[int, int]) -> list[FaceCrop]:
    """The small faces: weight 1 up to a width of `FACE_SHAPE.small_face`, falling to 0 at `FACE_SHAPE.large_face`.

    Args:
        size, picture: (width, height) of the frame, in whose px the faces are, and of the picture.
    """
    return face_crops(faces, size, picture, 1 - largeness(faces, size))


def face_crops(
    faces: Faces, size: tuple[int, int], picture: tuple[int, int], factors: NDArray[np.float64]
) -> list[FaceCrop]:  # fmt: skip
    """Faces in a picture whose weight is their strength times a factor each, without those of no weight.

    Args:
        size, picture: as for `small_faces`.
        factors: (n,), 0..1.
    """
    out = []
    across, down = np.divide(picture, size)
    boxes = faces["box"] * (across, down, across, down)
    weights = (faces["strength"] * factors).astype(np.float32)
    for (cx, cy, w, h), weight in zip(boxes.tolist(), weights, strict=True):
        half_x, half_y, top = w * FACE_SHAPE.half_width, h * FACE_SHAPE.half_height, cy - h * FACE_SHAPE.raised
        x0, x1 = (
            max(0, math.floor(cx - FACE_SHAPE.fade * half_x)),
            min(picture[0], math.ceil(cx + FACE_SHAPE.fade * half_x)),
        )
        y0, y1 = (
            max(0, math.floor(top - FACE_SHAPE.fade * half_y)),
            min(picture[1], math.ceil(top + FACE_SHAPE.fade * half_y)),
        )
        if weight < 0.02 or x0 >= x1 or y0 >= y1:
            continue
        box = slice(y0, y1), slice(x0, x1)
        head = _soft_ellipse(box, (cx, top), (half_x, half_y), FACE_SHAPE.fade)
        out.append(FaceCrop(box, weight * head, (cx, cy, w, h)))
    return out


def _soft_ellipse(
    box: tuple[slice, slice], centre: tuple[float, float], semi_axes: tuple[float, float], fade: float
) -> Plane:
    """1 in an ellipse, falling to 0 at `fade` times its size: float32, of the shape of `box`.

    Args:
        box: rows and columns of a picture; centre, semi_axes: (x, y), px of the picture.
    """
    rows, columns = box
    out = np.empty((rows.stop - rows.start, columns.stop - columns.start), np.float32)
    shifts = np.float32(0.5 - centre[0]), np.float32(0.5 - centre[1])
    units = np.float32(semi_axes[0]), np.float32(semi_axes[1])
    _fill_ellipse(out, (columns.start, rows.start), shifts, units, np.float32(fade))
    return out


@kernel
def _fill_ellipse(
    out: Plane, corner: tuple[int, int], shifts: tuple[np.float32, np.float32], units: tuple[np.float32, np.float32],
    fade: np.float32,
) -> None:  # fmt: skip
    """Fill a box as `_soft_ellipse` says.

    Args:
        corner: its first pixel (x, y), px of the picture.
        shifts: (x, y) that give, added to the number of a pixel, the distance of its middle from the ellipse's centre.
        units: the semi-axes, px.
    """
    height, width = out.shape
    squares = np.empty(width, np.float32)
    for x in range(width):
        across = (np.float32(corner[0] + x) + shifts[0]) / units[0]
        squares[x] = across * across
    for y in range(height):
        down = (np.float32(corner[1] + y) + shifts[1]) / units[1]
        for x in range(width):  # this vectorises
            out[y, x] = _soft_edge(np.sqrt(squares[x] + down * down), fade)


@kernel
def _soft_edge(distance: np.float32, fade: np.float32) -> np.float32:
    """1 up to a distance of 1, falling to 0 at `fade`."""
    ramp = min(max((fade - distance) / (fade - np.float32(1)), np.float32(0)), np.float32(1))
    return ramp * ramp * (np.float32(3) - np.float32(2) * ramp)


def head_mask(faces: Faces, size: tuple[int, int], shape: tuple[int, int]) -> Plane:
    """Soft mask of the heads, times their strength: float32, a grid of `shape` over the frame, 0..1.

    Args:
        size: (width, height) of the frame, px.
        shape: (rows, columns) of the grid.
    """
    height, width = shape
    cell = np.float32(size[0] / width), np.float32(size[1] / height)
    plane = np.zeros(shape, np.float32)
    _add_heads(faces["box"].astype(np.float32), faces["strength"].astype(np.float32), cell, plane)
    return plane


@kernel
def _add_heads(
    boxes: NDArray[np.float32], strengths: NDArray[np.float32], cell: tuple[np.float32, np.float32], plane: Plane
) -> None:  # fmt: skip
    """Raise the plane to the masks of the heads. `cell`: width and height of a cell, px."""
    height, width = plane.shape
    squares = np.empty(width, np.float32)
    for k in range(len(boxes)):
        half_x = max(boxes[k, 2] * np.float32(FACE_SHAPE.half_width), np.float32(FACE_SHAPE.least_cells) * cell[0])
        half_y = max(boxes[k, 3] * np.float32(FACE_SHAPE.half_height), np.float32(FACE_SHAPE.least_cells) * cell[1])
        raised = boxes[k, 3] * np.float32(FACE_SHAPE.raised)
        for x in range(width):
            across = ((np.float32(x) + np.float32(0.5)) * cell[0] - boxes[k, 0]) / half_x
            squares[x] = across * across
        for y in range(height):
            down = ((np.float32(y) + np.float32(0.5)) * cell[1] - boxes[k, 1] + raised) / half_y
            for x in range(width):  # this vectorises
                own = strengths[k] * _soft_edge(np.sqrt(squares[x] + down * down), np.float32(FACE_SHAPE.fade))
                plane[y, x] = max(plane[y, x], own)
