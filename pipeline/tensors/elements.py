"""Design elements: patterns of strokes that a person places, and that move with the object they were placed on."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from pipeline.errors import BadParameter
from pipeline.tensors.ellipses import Ellipse
from pipeline.tensors.field import Field, turned

Pattern: TypeAlias = Literal["regular", "wedge", "trisector", "node", "center", "saddle"]

WINDINGS: dict[Pattern, int] = {"regular": 0, "wedge": 1, "trisector": -1, "node": 2, "center": 2, "saddle": -2}
"""How often theta turns on the way round the centre: twice the index of the singularity."""


@dataclass(frozen=True)
class Element:
    """One pattern of strokes.

    Attributes:
        pattern: regular: parallel strokes; wedge: round one end; trisector: three bundles; node: rays; center:
            circles; saddle: a crossing.
        x, y: px, its centre, which may lie outside its region and outside the picture.
        angle_rad: how far the whole pattern is turned, from x towards y; regular strokes run at this angle.
        decay_per_px: d of equation 4, >= 0: at 1 / d px from the centre 37 % are left.
        strength: rho near the centre, >= 0.
    """

    pattern: Pattern
    x: float
    y: float
    angle_rad: float = 0.0
    decay_per_px: float = 0.0
    strength: float = 1.0

    def __post_init__(self) -> None:
        if self.pattern not in WINDINGS:
            known = ", ".join(WINDINGS)
            raise BadParameter("No such pattern.", field="pattern", value=self.pattern, remedy=f"Use one of {known}.")
        for field in ("x", "y", "angle_rad", "decay_per_px", "strength"):
            value = getattr(self, field)
            if not math.isfinite(value) or (value < 0 and field in ("decay_per_px", "strength")):
                raise BadParameter("It is a number in its range.", field=field, value=value, remedy="See Element.")


def basis_field(element: Element, size: tuple[int, int]) -> Field:
    """The element's tensors over a picture of `size` (height, width): float32 (2, h, w).

    Source: kagaya2011video, equation 4; the patterns of zhang2007interactive.

    Departure: the paper's M grows with the distance, a wedge's linearly, a node's by the square. Here it is of length 1
    from a pixel or so off the centre, so that strength and decay mean the same for each pattern.
    """
    y, x = np.indices(size, np.float64)
    dx, dy = x - element.x, y - element.y
    way = (dx + 1j * dy) * np.exp(-1j * element.angle_rad)
    radius = np.abs(way)
    winding = WINDINGS[element.pattern]
    towards = way if winding >= 0 else way.conj()
    pattern = (towards / np.sqrt(radius**2 + 1)) ** abs(winding)
    if element.pattern == "center":
        pattern = -pattern
    tensors = element.strength * np.exp(-element.decay_per_px * radius) * pattern
    return turned(np.stack([tensors.real, tensors.imag]).astype(np.float32), element.angle_rad)


def design_field(edges: Field, elements: Iterable[Element], edge_weight: float) -> Field:
    """What directs the strokes of a region: P = w E + (1 - w) sum of M, float32 (2, h, w).

    Args:
        edges: float32 (2, h, w), from `edge_field`.
        elements: those placed on the region.
        edge_weight: w in [0, 1]; 1 = as the picture runs, 0 = as designed.

    Raises:
        BadParameter: `edge_weight` is out of its range.
    """
    if not 0 <= edge_weight <= 1:
        raise BadParameter("It is between 0 and 1.", field="edge_weight", value=edge_weight, remedy="Use 0.5.")
    total = np.float32(edge_weight) * edges
    for element in elements:
        total = total + np.float32(1 - edge_weight) * basis_field(element, (edges.shape[1], edges.shape[2]))
    return np.asarray(total, np.float32)


def follow(element: Element, key: Ellipse, now: Ellipse) -> Element:
    """The element as the object has moved, turned and grown since its keyframe.

    Its centre keeps its place along the axes of the ellipse, each scaled by itself; the pattern turns by as much as
    the major axis, and reaches as much further as the object is larger.

    Args:
        element: as placed in the keyframe.
        key: the object's ellipse in the keyframe.
        now: in this frame, from `fit_ellipse`, frame by frame.
    """
    across = complex(element.x - key.x, element.y - key.y) * complex(math.cos(key.angle_rad), -math.sin(key.angle_rad))
    moved = complex(across.real * now.major_px / key.major_px, across.imag * now.minor_px / key.minor_px)
    place = moved * complex(math.cos(now.angle_rad), math.sin(now.angle_rad))
    scale = math.sqrt(now.major_px * now.minor_px / (key.major_px * key.minor_px))
    return replace(
        element, x=now.x + place.real, y=now.y + place.imag, decay_per_px=element.decay_per_px / scale,
        angle_rad=element.angle_rad + now.angle_rad - key.angle_rad,
    )  # fmt: skip
