"""Whose style a pixel has: its share of every region with a style of its own.

A pixel of such a region has all of it. Where regions have none, each share solves Laplace's equation; over a soft
border they change gradually. Whatever the style's parameter, and there are eleven, its value is the same mix: so it is
shares that are solved for and smoothed, and pictures have few regions with a style.

Source: kagaya2011video, section 3.1, eq. 1. Departure: by the superposition of solutions, as told.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask, Plane
from pipeline.methods.multistyle.carrier import Map
from pipeline.solvers import Multigrid, Solution

Shares = NDArray[np.float32]
"""float32 (keys + 1, h, w), 0..1; together they are 1. The last one is of what no key region reaches."""


def spread(found: Map, keys: Sequence[int], walls: dict[str, NDArray[np.float32]]) -> tuple[Shares, Solution | None]:
    """Shares of a (coarse) region map; and how the equations were solved, where there were any.

    Args:
        keys: numbers of the regions that have a style.
        walls: weights of the edges between pixels, as `Multigrid` takes them.
    """
    own = np.stack([*(found == key for key in keys), np.zeros(found.shape, np.bool_)]).astype(np.float32)
    fixed = np.isin(found, keys)
    if fixed.all():
        return own, None
    solver = Multigrid(fixed, **walls)
    out, solution = np.zeros_like(own), None
    if len(keys) > 1:  # the last one is what is left
        solution = solver.solve(own[: len(keys) - 1])
        out[: len(keys) - 1] = solution.x
    if keys:
        out[len(keys) - 1] = 1 - out[:-2].sum(axis=0)
    out[:, solver.adrift] = 0
    out[-1, solver.adrift] = 1
    return out, solution


def widened(coarse: Shares, found: Map, keys: Sequence[int]) -> Shares:
    """Coarse shares at the size of the map `found`; to the pixel in regions that have a style."""
    fixed, size = np.isin(found, keys), (found.shape[1], found.shape[0])
    out = np.empty((len(coarse), *found.shape), np.float32)
    for index, plane in enumerate(coarse):
        wide = cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR)
        own = found == keys[index] if index < len(keys) else np.zeros(found.shape, np.bool_)
        out[index] = np.where(fixed, own, wide)
    return out


def softened(shares: Shares, inside: Mask, sigma_px: float, small: tuple[int, int]) -> Shares:
    """Shares that change gradually over the border of the mask, bool (h, w).

    Args:
        sigma_px: of the Gaussian over which they change.
        small: (width, height) that blurring is done at; smooth as it is, that loses nothing.
    """
    size, scale = (inside.shape[1], inside.shape[0]), small[1] / inside.shape[0]
    near = _blurred(inside.astype(np.float32), sigma_px * scale, small, size)
    band = np.clip(4 * near * (1 - near), 0, 1)
    return np.stack([
        plane + band * (_blurred(plane, sigma_px * scale, small, size) - plane) for plane in shares
    ]).astype(np.float32)  # fmt: skip


def _blurred(plane: Plane, sigma_px: float, small: tuple[int, int], size: tuple[int, int]) -> Plane:
    coarse = cv2.GaussianBlur(cv2.resize(plane, small, interpolation=cv2.INTER_AREA), (0, 0), sigma_px)
    return np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR), np.float32)


def mixed(shares: Shares, values: NDArray[np.float32]) -> Plane:
    """The sum of `values`, float32 (keys + 1,), by their shares: float32 (h, w).

    In a loop, not by a product of matrices: those round otherwise on another processor.
    """
    out = np.zeros(shares.shape[1:], np.float32)
    for share, value in zip(shares, values, strict=True):
        out += share * value
    return out
