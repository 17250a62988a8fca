"""Pose of a cut-out: an affine map from its plane to the picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Affine map (x, y) -> (a x + b y + tx, c x + d y + ty). `p @ q` applies q first."""

    a: float = 1.0
    b: float = 0.0
    c: float = 0.0
    d: float = 1.0
    tx: float = 0.0
    ty: float = 0.0

    @classmethod
    def shift(cls, x: float, y: float) -> Pose:
        return cls(tx=x, ty=y)

    @classmethod
    def rotate(cls, angle_rad: float) -> Pose:
        """Rotation about the origin; positive angles are clockwise on the screen, since y points down."""
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        return cls(cos, -sin, sin, cos)

    @classmethod
    def scale(cls, x: float, y: float | None = None) -> Pose:
        return cls(a=x, d=x if y is None else y)

    def __matmul__(self, first: Pose) -> Pose:
        return Pose(
            self.a * first.a + self.b * first.c,
            self.a * first.b + self.b * first.d,
            self.c * first.a + self.d * first.c,
            self.c * first.b + self.d * first.d,
            self.a * first.tx + self.b * first.ty + self.tx,
            self.c * first.tx + self.d * first.ty + self.ty,
        )

    def apply(self, x: Array, y: Array) -> tuple[Array, Array]:
        return self.a * x + self.b * y + self.tx, self.c * x + self.d * y + self.ty

    @property
    def area(self) -> float:
        """Factor by which the map scales areas."""
        return abs(self.a * self.d - self.b * self.c)

    def inverse(self) -> Pose:
        determinant = self.a * self.d - self.b * self.c
        a, b, c, d = self.d / determinant, -self.b / determinant, -self.c / determinant, self.a / determinant
        return Pose(a, b, c, d, -(a * self.tx + b * self.ty), -(c * self.tx + d * self.ty))
