"""Design elements: stroke patterns placed by a user, which move with the object that they were placed on."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.tensors.ellipses import Ellipse
from pipeline.tensors.field import OrientationField, rotated

Pattern: TypeAlias = Literal["regular", "wedge", "trisector", "node", "center", "spiral", "saddle"]

WINDINGS: dict[Pattern, int] = {
    "regular": 0, "wedge": 1, "trisector": -1, "node": 2, "center": 2, "spiral": 2, "saddle": -2,
}  # fmt: skip
"""Turns of theta on the way round the centre: twice the index of the singularity."""
TILT_RAD: dict[Pattern, float] = {"node": 0.0, "center": math.pi / 2, "spiral": math.pi / 4}
"""Angle between strokes and rays from the centre, for the rotationally symmetric patterns."""


@dataclass(frozen=True)
class Element:
    """One pattern of strokes.

    Attributes:
        pattern: regular: parallel strokes; wedge: strokes around one end; trisector: three bundles; node: rays;
            center: circles; spiral: logarithmic spirals; saddle: a crossing.
        x, y: centre, px; may lie outside the region and the picture.
        angle_rad: rotation of the whole pattern, from x towards y; regular strokes run at this angle. A node, center or
            spiral is symmetric under rotation; there the angle turns each stroke relative to the ray from the centre,
            so a node at 90 degrees is a center.
        decay_per_px: d of equation 4, >= 0: at 1 / d px from the centre 37 % of the strength is left.
        strength: rho near the centre, >= 0.
        stretch: factor > 0 by which the whole pattern is stretched along the direction `stretch_rad`; it is compressed
            by as much across it.
    """

    pattern: Pattern
    x: float
    y: float
    angle_rad: float = 0.0
    decay_per_px: float = 0.0
    strength: float = 1.0
    stretch: float = 1.0
    stretch_rad: float = 0.0

    def __post_init__(self) -> None:
        if self.pattern not in WINDINGS:
            known = ", ".join(WINDINGS)
            raise BadParameter("Unknown pattern.", field="pattern", value=self.pattern, remedy=f"Use one of {known}.")
        for field in ("x", "y", "angle_rad", "decay_per_px", "strength"):
            value = getattr(self, field)
            if not math.isfinite(value) or (value < 0 and field in ("decay_per_px", "strength")):
                raise BadParameter(
                    "The value must be finite, and not negative for decay and strength.", field=field, value=value,
                    remedy="Use 0 or a positive number.",
                )  # fmt: skip


def basis_field(element: Element, size: tuple[int, int]) -> OrientationField:
    """Basis field of the element for a picture of `size` (height, width): float32 (2, h, w).

    Source: kagaya2011video, equation 4; the patterns of zhang2007interactive.

    Departure: the paper's M grows with the distance, linearly for a wedge, quadratically for a node. Here its length is
    1 from about a pixel off the centre on, so that strength and decay mean the same for each pattern.
    """
    y, x = np.indices(size, np.float64)
    dx, dy = x - element.x, y - element.y
    symmetric = element.pattern in TILT_RAD
    offset = _stretched(dx + 1j * dy, 1 / element.stretch, element.stretch_rad)
    offset = offset * np.exp(-1j * (0.0 if symmetric else element.angle_rad))
    radius = np.abs(offset)
    winding = WINDINGS[element.pattern]
    towards = offset if winding >= 0 else offset.conj()
    pattern = (towards / np.sqrt(radius**2 + 1)) ** abs(winding)
    tensors = element.strength * np.exp(-element.decay_per_px * radius) * pattern
    rotation_rad = element.angle_rad + TILT_RAD.get(element.pattern, 0.0)
    field = rotated(np.stack([tensors.real, tensors.imag]).astype(np.float32), rotation_rad)
    return field if element.stretch == 1 else _stretched_field(field, element.stretch, element.stretch_rad)


def _stretched(
    offsets: NDArray[np.complex128], stretch: float, axis_rad: float
) -> NDArray[np.complex128]:  # fmt: skip
    """Offsets x + iy, stretched along the axis and compressed across it."""
    if stretch == 1:
        return offsets
    turned = offsets * np.exp(-1j * axis_rad)
    return np.asarray((turned.real * stretch + 1j * turned.imag / stretch) * np.exp(1j * axis_rad), np.complex128)


def _stretched_field(field: OrientationField, stretch: float, axis_rad: float) -> OrientationField:
    """The field with the directions of a stretched picture, and the same strength."""
    doubled = (field[0] + 1j * field[1]).astype(np.complex128)
    strength = np.abs(doubled)
    along = _stretched(np.exp(0.5j * np.angle(doubled)), stretch, axis_rad)
    turned = strength * np.exp(2j * np.angle(along))
    return np.stack([turned.real, turned.imag]).astype(np.float32)


def design_field(edges: OrientationField, elements: Iterable[Element], edge_weight: float) -> OrientationField:
    """Orientation field of a region: P = w E + (1 - w) sum of M, float32 (2, h, w).

    Args:
        edges: float32 (2, h, w), from `edge_field`.
        elements: placed on the region.
        edge_weight: w in [0, 1]; 1 = edge field only, 0 = elements only.

    Raises:
        BadParameter: `edge_weight` is out of its range.
    """
    if not 0 <= edge_weight <= 1:
        raise BadParameter(
            "The edge weight must be between 0 and 1.", field="edge_weight", value=edge_weight, remedy="Use 0.5."
        )
    total = np.float32(edge_weight) * edges
    for element in elements:
        total = total + np.float32(1 - edge_weight) * basis_field(element, (edges.shape[1], edges.shape[2]))
    return np.asarray(total, np.float32)


def follow(element: Element, key: Ellipse, now: Ellipse) -> Element:
    """Move the element with its object since the keyframe.

    The centre keeps its coordinates relative to the ellipse's axes; the pattern rotates with the major axis, its reach
    scales with the object's size, and it is stretched as the object is.

    Source: kagaya2011video, section 3.2 (translation, rotation, isotropic and anisotropic scaling).

    Args:
        element: as placed in the keyframe.
        key: the object's ellipse in the keyframe.
        now: the object's ellipse in this frame, with a continuous angle (see `fit_ellipse`).
    """
    across = complex(element.x - key.x, element.y - key.y) * complex(math.cos(key.angle_rad), -math.sin(key.angle_rad))
    moved = complex(across.real * now.major_px / key.major_px, across.imag * now.minor_px / key.minor_px)
    place = moved * complex(math.cos(now.angle_rad), math.sin(now.angle_rad))
    scale = math.sqrt(now.major_px * now.minor_px / (key.major_px * key.minor_px))
    stretch = math.sqrt(now.major_px * key.minor_px / (key.major_px * now.minor_px))
    return replace(
        element, x=now.x + place.real, y=now.y + place.imag, decay_per_px=element.decay_per_px / scale,
        angle_rad=element.angle_rad + (0.0 if element.pattern in TILT_RAD else now.angle_rad - key.angle_rad),
        stretch=stretch, stretch_rad=now.angle_rad,
    )  # fmt: skip
