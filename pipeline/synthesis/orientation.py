"""Directions as 64 steps of a half turn, from tangents or angles; the same steps on every processor."""

from __future__ import annotations

import numpy as np

from pipeline.frames import Flow, Plane
from pipeline.synthesis.goal import NO_DIRECTION, TURNS
from pipeline.synthesis.images import Bytes
from pipeline.tensors.structure import structure_tensor, tangent_field

_EDGES = -np.cos((np.arange(TURNS) + 0.5) * (np.pi / TURNS)).astype(np.float32)


def bins_of(tangents: Flow) -> Bytes:
    """Steps 0..63 of directions, counted from x (right) towards y (down); 255 where there is none.

    Args:
        tangents: float32 (h, w, 2): unit vectors, whose sign means nothing; (0, 0) = none.

    By comparing cosines, since arc tangents do not round alike on every processor.
    """
    x, y = tangents[..., 0], tangents[..., 1]
    along = np.where((y < 0) | ((y == 0) & (x < 0)), -x, x)
    found = np.searchsorted(_EDGES, -along).astype(np.uint8) % TURNS
    return np.where((x == 0) & (y == 0), np.uint8(NO_DIRECTION), found.astype(np.uint8))


def bins_of_angles(angles: Plane) -> Bytes:
    """Steps of angles in radians."""
    return np.asarray(np.rint(angles * np.float32(TURNS / np.pi)).astype(np.int64) % TURNS, np.uint8)


def orientation(gray: Bytes, sigma_px: float = 3.0, flat: float = 1.0) -> Bytes:
    """The direction in which a picture runs, by its structure tensor: steps 0..63, 255 where it runs nowhere.

    Args:
        gray: uint8 (h, w).
        sigma_px: of the tensor's smoothing.
        flat: up to this difference of the tensor's eigenvalues there is no direction, (gray levels/px)^2.

    Source: benard2013stylizing, section 3.1. Departure: where there is no direction, patches are not turned.
    """
    return bins_of(tangent_field(structure_tensor(gray.astype(np.float32), sigma_px), flat))
