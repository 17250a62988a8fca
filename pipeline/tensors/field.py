"""Orientation fields: a traceless symmetric tensor per pixel, (u, v) = rho (cos theta, sin theta).

A stroke follows the eigenvector of the eigenvalue +rho, at the angle theta / 2; rho is the strength. Angles that differ
by half a turn are the same tensor, so there is no branch cut, and fields can be added, averaged and interpolated per
component (kagaya2011video, section 3.2).
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.frames import Mask, Plane
from pipeline.solvers import Multigrid, Solution

OrientationField: TypeAlias = NDArray[np.float32]
"""`float32` (2, height, width): the planes u and v. Angles are measured from x towards y, clockwise on the screen."""


def field_of(angle_rad: AnyArray | float, strength: AnyArray | float = 1.0) -> OrientationField:
    """Orientation field of strokes at these angles: float32 (2, *shape); `strength` is rho, >= 0."""
    twice = 2 * np.asarray(angle_rad, np.float64)
    return np.stack([strength * np.cos(twice), strength * np.sin(twice)]).astype(np.float32)


def angle_of(field: OrientationField) -> Plane:
    """Stroke angles, float32 (h, w) in [0, pi); 0 where the field is 0."""
    half = (np.arctan2(field[1], field[0]) / 2).astype(np.float32)
    positive = np.where(half < 0, half + np.float32(math.pi), half)
    return np.where(positive >= np.float32(math.pi), np.float32(0), positive).astype(np.float32)


def strength_of(field: OrientationField) -> Plane:
    """Strength rho, float32 (h, w)."""
    return np.asarray(np.sqrt(field[0] * field[0] + field[1] * field[1]))


def rotated(field: OrientationField, angle_rad: AnyArray | float) -> OrientationField:
    """Rotate each tensor in place, so that strokes turn by `angle_rad`: float32 (2, h, w)."""
    c, s = np.cos(2 * np.asarray(angle_rad, np.float64)), np.sin(2 * np.asarray(angle_rad, np.float64))
    return np.stack([c * field[0] - s * field[1], s * field[0] + c * field[1]]).astype(np.float32)


def fill_free(
    field: OrientationField, key: Mask, *, right: AnyArray | None = None, down: AnyArray | None = None,
    start: OrientationField | None = None,
) -> Solution:  # fmt: skip
    """Extend the field of the key regions over the free regions: attribute `x` of the result, float32 (2, h, w).

    Args:
        field: float32 (2, h, w), read where `key`.
        key: bool (h, w): pixels with given direction.
        right, down: weights of the edges between neighbours, as `Multigrid` takes them; 0 separates the two sides.
            Pixels that no key region reaches become (0, 0).
        start: field of the previous frame as initial guess.

    Source: kagaya2011video, section 3.2: a pair of Laplace equations.
    """
    return Multigrid(key, right=right, down=down).solve(field, start=start)
