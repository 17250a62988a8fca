"""Quantisation of directions to 64 steps of 180 degrees, from tangents or angles; identical on every processor."""

from __future__ import annotations

import numpy as np

from pipeline.frames import Flow, Plane
from pipeline.synthesis.energy import NO_DIRECTION, TURNS
from pipeline.synthesis.images import Bytes
from pipeline.tensors.structure import structure_tensor, tangent_field

_EDGES = -np.cos((np.arange(TURNS) + 0.5) * (np.pi / TURNS)).astype(np.float32)


def bins_of(tangents: Flow) -> Bytes:
    """Quantise tangents to steps 0..63, counted from x (right) towards y (down); 255 = no direction. uint8 (h, w).

    Compares cosines, because arc tangents do not round identically on every processor.

    Args:
        tangents: float32 (h, w, 2): unit vectors with arbitrary sign; (0, 0) = no direction.
    """
    x, y = tangents[..., 0], tangents[..., 1]
    along = np.where((y < 0) | ((y == 0) & (x < 0)), -x, x)
    found = np.searchsorted(_EDGES, -along).astype(np.uint8) % TURNS
    return np.where((x == 0) & (y == 0), np.uint8(NO_DIRECTION), found.astype(np.uint8))


def bins_of_angles(angles: Plane) -> Bytes:
    """Quantise angles, radians, to steps 0..63; uint8 (h, w)."""
    return np.asarray(np.rint(angles * np.float32(TURNS / np.pi)).astype(np.int64) % TURNS, np.uint8)


def orientation(gray: Bytes, sigma_px: float = 3.0, flat: float = 1.0) -> Bytes:
    """Dominant direction of a picture from its structure tensor: steps 0..63, 255 = no direction. uint8 (h, w).

    Args:
        gray: uint8 (h, w).
        sigma_px: standard deviation of the Gaussian that smooths the tensor, px.
        flat: maximum difference of the tensor's eigenvalues that counts as no direction, (gray levels/px)^2.

    Source: benard2013stylizing, section 3.1. Departure: patches at pixels without direction are not rotated.
    """
    return bins_of(tangent_field(structure_tensor(gray.astype(np.float32), sigma_px), flat))
