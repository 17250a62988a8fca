"""Quantisation of directions to 64 steps of 180 degrees; identical on every processor."""

from __future__ import annotations

import numpy as np

from pipeline.frames import Flow
from pipeline.synthesis.energy import DIRECTIONS, NO_DIRECTION
from pipeline.synthesis.images import Bytes
from pipeline.tensors.structure import structure_tensor, tangent_field

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


def orientation(gray: Bytes, sigma_px: float = 3.0, flat: float = 1.0) -> Bytes:
    """Dominant direction of a picture from its structure tensor: steps 0..63, 255 = no direction. uint8 (h, w).

    Args:
        gray: uint8 (h, w).
        sigma_px: standard deviation of the Gaussian that smooths the tensor, px.
        flat: maximum difference of the tensor's eigenvalues that counts as no direction, (gray levels/px)^2.

    Source: benard2013stylizing, section 3.1. Departure: patches at pixels without direction are not rotated.
    """
    return direction_bins(tangent_field(structure_tensor(gray.astype(np.float32), sigma_px), flat))
