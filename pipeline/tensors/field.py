"""Directions of strokes: a traceless symmetric tensor per pixel, (u, v) = rho (cos theta, sin theta).

A stroke runs along the eigenvector of the eigenvalue +rho, at the angle theta / 2, and rho says how much that matters.
So an angle and the angle half a turn on are one tensor, there is no branch cut, and fields can be added, averaged and
spread like any two numbers (kagaya2011video, section 3.2).
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Mask, Plane
from pipeline.solvers import Multigrid, Solution
from pipeline.tensors.structure import tangent_field

Field: TypeAlias = NDArray[np.float32]
"""`float32` (2, height, width): the planes u and v. Angles turn from x towards y, clockwise as it is seen."""

SAMPLES = 64
"""Of a circle round a singularity; between two of them theta must not turn by half a turn."""


def field_of(angle_rad: NDArray[Any] | float, strength: NDArray[Any] | float = 1.0) -> Field:
    """The tensors of strokes at these angles, float32 (2, *shape); `strength` is rho, >= 0."""
    twice = 2 * np.asarray(angle_rad, np.float64)
    return np.stack([strength * np.cos(twice), strength * np.sin(twice)]).astype(np.float32)


def angle_of(field: Field) -> Plane:
    """The strokes' angles, float32 (h, w) in [0, pi); 0 where the field has no direction."""
    half = (np.arctan2(field[1], field[0]) / 2).astype(np.float32)
    turned = np.where(half < 0, half + np.float32(math.pi), half)
    return np.where(turned >= np.float32(math.pi), np.float32(0), turned).astype(np.float32)


def strength_of(field: Field) -> Plane:
    """rho, float32 (h, w)."""
    return np.asarray(np.sqrt(field[0] * field[0] + field[1] * field[1]))


def direction_of(field: Field, least: float = 1e-6) -> Flow:
    """Unit vectors along the strokes, float32 (h, w, 2), of either sign; (0, 0) where rho is at most `least`."""
    return tangent_field(np.stack([-field[0], -field[1] / 2, np.zeros_like(field[0])]), least)


def turned(field: Field, angle_rad: NDArray[Any] | float) -> Field:
    """Every tensor turned where it stands, so that its stroke is `angle_rad` further round: float32 (2, h, w)."""
    c, s = np.cos(2 * np.asarray(angle_rad, np.float64)), np.sin(2 * np.asarray(angle_rad, np.float64))
    return np.stack([c * field[0] - s * field[1], s * field[0] + c * field[1]]).astype(np.float32)


def fill_free(
    field: Field, key: Mask, *, right: NDArray[Any] | None = None, down: NDArray[Any] | None = None,
    start: Field | None = None,
) -> Solution:  # fmt: skip
    """Spread the field of the key regions over the free ones: `x` of the result, float32 (2, h, w).

    Args:
        field: float32 (2, h, w), read where `key`.
        key: bool (h, w): pixels whose direction is given.
        right, down: weights of the edges between neighbours, as `Multigrid` takes them: 0 keeps what is on either side
            of a border apart. What no key region reaches has no direction, (0, 0).
        start: the field of the frame before, which saves V-cycles.

    Source: kagaya2011video, section 3.2: a pair of Laplace equations.
    """
    return Multigrid(key, right=right, down=down).solve(field, start=start)


def index_around(field: Field, x: float, y: float, radius_px: float) -> float:
    """How often strokes turn, in whole turns, on the way once round (x, y): a multiple of 1/2.

    0 where nothing is singular inside; wedge 1/2, trisector -1/2, node and centre 1, saddle -1. The circle lies in the
    picture and meets no place without direction.
    """
    way = np.arange(SAMPLES) * (2 * math.pi / SAMPLES)
    px, py = (x + radius_px * np.cos(way)).astype(np.float32), (y + radius_px * np.sin(way)).astype(np.float32)
    u, v = (cv2.remap(plane, px, py, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel() for plane in field)
    along = u + 1j * v
    steps = np.angle(np.roll(along, -1) * along.conj())
    return round(float(steps.sum()) / (2 * math.pi)) / 2
