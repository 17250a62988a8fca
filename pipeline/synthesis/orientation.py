"""Directions of style and input, in 64 steps of 180 degrees; identical on every processor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.frames import Flow, Frame, Plane
from pipeline.synthesis.energy import DIRECTIONS, NO_DIRECTION
from pipeline.synthesis.images import Bytes
from pipeline.tensors.structure import Tensors, structure_tensor, tangent_field

_EDGES = -np.cos((np.arange(DIRECTIONS) + 0.5) * (np.pi / DIRECTIONS)).astype(np.float32)


def direction_bins(tangents: Flow) -> Bytes:
    """Quantise tangents to steps 0..63, counted from x (right) towards y (down); 255 = no direction. uint8 (h, w).

    Compares cosines, because arc tangents do not round identically on every processor.

    Args:
        tangents: float32 (h, w, 2): unit vectors with arbitrary sign; (0, 0) = no direction.
    """
    x, y = tangents[..., 0], tangents[..., 1]
    cosine = np.where((y < 0) | ((y == 0) & (x < 0)), -x, x)
    bins = np.searchsorted(_EDGES, -cosine).astype(np.uint8) % DIRECTIONS
    return np.where((x == 0) & (y == 0), np.uint8(NO_DIRECTION), bins.astype(np.uint8))


def bin_tangents(bins: Bytes) -> Flow:
    """Unit vectors of steps of `direction_bins`, float32 (h, w, 2), y down; (0, 0) = no direction."""
    angles = np.arange(DIRECTIONS) * (np.pi / DIRECTIONS)
    vectors = np.zeros((256, 2), np.float32)
    vectors[:DIRECTIONS] = np.stack([np.cos(angles), np.sin(angles)], -1)
    return np.asarray(vectors[bins])


def orientation(gray: Bytes, sigma_px: float = 3.0, flat: float = 1.0) -> Bytes:
    """Dominant direction of a picture from its structure tensor: steps 0..63, 255 = no direction. uint8 (h, w).

    Args:
        gray: uint8 (h, w).
        sigma_px: standard deviation of the Gaussian that smooths the tensor, px.
        flat: maximum difference of the tensor's eigenvalues that counts as no direction, (gray levels/px)^2.

    Source: benard2013stylizing, section 3.1. Departure: patches at pixels without direction are not rotated.
    """
    return direction_bins(tangent_field(structure_tensor(gray.astype(np.float32), sigma_px), flat))


_LINE_GRADIENT = 16.0
"""Gradient given to distances from lines, gray levels/px, so that `flat` has the same meaning as for pictures."""
_LEAST_VECTOR = 0.25
"""Length below which the vector of a direction picture means no direction; 1 = full length."""
_LEAST_ANISOTROPY = 0.1
"""Difference of eigenvalues below which averaged authored directions contradict each other."""


def line_orientation(distance: Plane, reach_px: float, sigma_px: float) -> Bytes:
    """Direction of the nearest line of a line drawing, up to `reach_px` from it: steps 0..63, 255 elsewhere.

    Args:
        distance: distance to the nearest line, px, float32 (h, w).
        sigma_px: standard deviation of the Gaussian that smooths directions, px.
    """
    ramp = np.minimum(distance, np.float32(reach_px)) * np.float32(_LINE_GRADIENT)
    bins = direction_bins(tangent_field(structure_tensor(ramp, sigma_px), 1.0))
    return np.where(distance <= reach_px, bins, np.uint8(NO_DIRECTION)).astype(np.uint8)


def authored_tensors(picture: Frame | Plane) -> Plane:
    """Decode a direction picture to structure tensors (xx, xy, yy), which can be averaged: float32 (h, w, 3).

    Args:
        picture: uint8 (h, w, 3). Red is the x component (0 = -1, 255 = 1), green the y component (255 = up), as in
            normal maps; blue is ignored. The sign of the vector is ignored. Gray (128, 128) = no direction. Or float32
            (h, w, 2), the components themselves.
    """
    coded = picture.dtype == np.uint8
    vector = picture[..., :2].astype(np.float32) / np.float32(127.5) - np.float32(1) if coded else picture[..., :2]
    x, y = vector[..., 0], -vector[..., 1]
    squared = x * x + y * y
    known = squared >= np.float32(_LEAST_VECTOR**2)
    scale = np.where(known, 1 / np.where(known, squared, np.float32(1)), np.float32(0))
    return np.stack([y * y * scale, -x * y * scale, x * x * scale], -1).astype(np.float32)


def authored_bins(tensors: Plane) -> Bytes:
    """Directions of decoded direction pictures: steps 0..63, 255 = no direction. uint8 (h, w)."""
    planes: Tensors = np.ascontiguousarray(tensors.transpose(2, 0, 1))
    return direction_bins(tangent_field(planes, _LEAST_ANISOTROPY))


@dataclass(frozen=True)
class DirectionSources:
    """Source of the directions of a picture.

    Attributes:
        gray: uint8 (h, w); its structure tensor gives the direction where no other source does.
        line_distance: distance to the nearest line, px, float32 (h, w); None = no lines.
        authored: as `authored_tensors` returns it; None = not given.
    """

    gray: Bytes
    line_distance: Plane | None = None
    authored: Plane | None = None

    def bins(self, sigma_px: float, reach_px: float) -> Bytes:
        """Directions: authored ones first, then those of near lines, then those of the picture. uint8 (h, w).

        Args:
            sigma_px: standard deviation of the Gaussian that smooths computed directions, px.
            reach_px: distance up to which lines determine the direction, px.

        Source: benard2013stylizing, section 3.1 (authored or computed) and fig. 6 (directions of lines).
        """
        found = orientation(self.gray, sigma_px)
        if self.line_distance is not None:
            found = _first(line_orientation(self.line_distance, reach_px, sigma_px), found)
        return found if self.authored is None else _first(authored_bins(self.authored), found)


def _first(preferred: Bytes, otherwise: Bytes) -> Bytes:
    return np.where(preferred == NO_DIRECTION, otherwise, preferred).astype(np.uint8)
