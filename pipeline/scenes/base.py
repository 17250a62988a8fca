"""Scene interface: flat cut-outs in back-to-front order with exact motions, and the passes of a renderer.

Picture units: x points right from the centre, y points down from 0 at the top to 1 at the bottom. The height is
therefore 1 at any resolution, and the width is the aspect ratio. A cut-out is defined in its own plane and placed by a
time-dependent pose. Its colour depends only on positions in its plane, so points keep their colour while they move.
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
    """Arguments of a paint: positions in the cut-out's plane, distance from its outline, and the pixel size there."""

    x: Array
    y: Array
    depth: Array
    """0 at the outline, growing inwards, in the cut-out's units."""
    pixel: float

    def at(self, visible: Mask) -> Spot:
        """Select the spots where `visible` is True, as 1-D arrays."""
        return Spot(self.x[visible], self.y[visible], self.depth[visible], self.pixel)


Paint: TypeAlias = Callable[[Spot], Array]
"""Colour of a spot: (..., 3), sRGB, 0..1 (clipped)."""
Motion: TypeAlias = Callable[[float], Pose]
"""Time in seconds -> pose from the cut-out's plane to the picture's units."""


@dataclass(frozen=True)
class CutOut:
    """One flat part of a scene."""

    thing: str
    """Name of the object it belongs to; cut-outs of one object share an id."""
    outline: Outline
    paint: Paint
    motion: Motion
    box: tuple[float, float, float, float] | None = None
    """Left, top, right, bottom of the outline in its own plane; None = unbounded."""
    bulge: float = 0.0
    """Depth from which on the normal points at the viewer, in the cut-out's units; 0 = flat."""
    line_px: float = 1.2
    """Width of its outline in the line pass; 0 = none."""


@dataclass(frozen=True)
class SceneFrame:
    """A frame with its exact passes, all (height, width, ...).

    A point of an object that is visible at p in frame t is at p + velocity_next(p) in frame t + 1, and was at
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
    """Coverage by visible outlines, 0..1."""
    occluded_next: Mask
    """True where the point is hidden or outside the picture in frame t + 1; all True in the last frame."""
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
