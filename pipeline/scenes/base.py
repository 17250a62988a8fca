"""What a scene is: cut-outs in painter's order, each with an exact motion, and every pass that a renderer would give.

The picture's units: x from the centre to the right, y from the top (0) to the bottom (1), so that the height is 1
whatever the size and the width depends on the aspect. A cut-out is drawn in its own plane and placed by a pose that
depends on time; its colour depends on its own plane alone, so that a point keeps its colour while it moves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Labels, Mask, Plane
from pipeline.scenes.outlines import Outline
from pipeline.scenes.pose import Array, Pose


@dataclass(frozen=True)
class Spot:
    """What a cut-out's colour may depend on: positions in its own plane, depth below its outline, a pixel's size."""

    x: Array
    y: Array
    depth: Array
    """0 at the outline, growing inwards, in the cut-out's units."""
    pixel: float

    def at(self, seen: Mask) -> Spot:
        """Some of the spots, as one row."""
        return Spot(self.x[seen], self.y[seen], self.depth[seen], self.pixel)


Paint: TypeAlias = Callable[[Spot], Array]
"""Colour of a spot: (..., 3), sRGB, 0..1 (clipped)."""
Motion: TypeAlias = Callable[[float], Pose]
"""Time in seconds -> pose from the cut-out's plane to the picture's units."""


@dataclass(frozen=True)
class CutOut:
    """One flat part of a scene."""

    thing: str
    """The object it belongs to; cut-outs of one object share an id."""
    outline: Outline
    paint: Paint
    motion: Motion
    box: tuple[float, float, float, float] | None = None
    """Left, top, right, bottom of the outline in its own plane; None = unbounded."""
    bulge: float = 0.0
    """From this depth on the surface faces us; 0 = flat."""
    line_px: float = 1.2
    """Width of its outline in the line pass; 0 = none."""


@dataclass(frozen=True)
class SceneFrame:
    """A frame with its exact passes, all (height, width, ...).

    A point of an object seen at p in frame t is at p + velocity_next(p) in frame t + 1, and was at
    p - velocity_previous(p) in frame t - 1 (benard2013stylizing's V+ and V-).
    """

    image: Frame
    ids: Labels
    """Object of each pixel's centre, 1..n; see `Scene.things`."""
    velocity_next: Flow
    velocity_previous: Flow
    normals: NDArray[np.float32]
    """float32 (height, width, 3): x right, y down, z towards us; length 1."""
    orientation: Plane
    """Direction along the nearest outline: angle from x (right) towards y (down), radians in [0, pi)."""
    lines: Plane
    """Coverage by outlines that are seen, 0..1."""
    occluded_next: Mask
    """True where the point is hidden or outside the picture in frame t + 1 (all True where there is none)."""
    occluded_previous: Mask


class Scene(Protocol):
    """A procedural video. The same arguments give the same bytes."""

    @property
    def name(self) -> str: ...
    @property
    def size(self) -> tuple[int, int]:
        """(width, height), px."""
        ...

    @property
    def frames(self) -> int: ...
    @property
    def fps(self) -> float: ...
    @property
    def things(self) -> Mapping[int, str]:
        """Id -> name of the object."""
        ...

    def image(self, index: int) -> Frame:
        """Frame `index` alone: several times faster than `frame`."""
        ...

    def frame(self, index: int) -> SceneFrame:
        """Frame `index` with every pass."""
        ...

    def __iter__(self) -> Iterator[SceneFrame]: ...
