"""Harmonic weights: how much each styled region contributes to the style of a pixel.

A pixel of a styled region takes that region's style. In regions without a style, each weight solves Laplace's equation
with the styled regions as boundary values; across soft borders weights change gradually. All style parameters are
mixed by the same weights, so one solution per region replaces one per parameter.

Source: kagaya2011video, section 3.1, eq. 1. Departure: superposition of solutions, which is equivalent.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Mask, Plane
from pipeline.methods.multistyle.label_propagation import RegionMap
from pipeline.solvers import Multigrid, Solution

Weights = NDArray[np.float32]
"""float32 (keys + 1, h, w), 0..1, sum 1. The last plane is the weight of the job's own style, where no styled region
can be reached."""


def solve_weights(
    regions: RegionMap, keys: Sequence[int], walls: dict[str, NDArray[np.float32]]
) -> tuple[Weights, Solution | None]:
    """Weights for a (coarse) region map, and the solver's report, None if nothing had to be solved.

    Args:
        keys: numbers of the styled regions.
        walls: weights of the edges between pixels, as `Multigrid` takes them.
    """
    own = np.stack([*(regions == key for key in keys), np.zeros(regions.shape, np.bool_)]).astype(np.float32)
    fixed = np.isin(regions, keys)
    if fixed.all():
        return own, None
    solver = Multigrid(fixed, **walls)
    out, solution = np.zeros_like(own), None
    if len(keys) > 1:  # the last one is the remainder to 1
        solution = solver.solve(own[: len(keys) - 1])
        out[: len(keys) - 1] = solution.x
    if keys:
        out[len(keys) - 1] = 1 - out[:-2].sum(axis=0)
    out[:, solver.undetermined] = 0
    out[-1, solver.undetermined] = 1
    return out, solution


def upscale(coarse: Weights, regions: RegionMap, keys: Sequence[int]) -> Weights:
    """Coarse weights at the size of the map `regions`; styled regions keep pixel-accurate borders."""
    fixed, size = np.isin(regions, keys), (regions.shape[1], regions.shape[0])
    out = np.empty((len(coarse), *regions.shape), np.float32)
    for index, plane in enumerate(coarse):
        wide = cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR)
        own = regions == keys[index] if index < len(keys) else np.zeros(regions.shape, np.bool_)
        out[index] = np.where(fixed, own, wide)
    return out


def soften(weights: Weights, inside: Mask, sigma_px: float, small: tuple[int, int]) -> Weights:
    """Blur weights across the border of a mask, bool (h, w).

    Args:
        sigma_px: sigma of the Gaussian, px.
        small: (width, height) at which the blur is computed.
    """
    size, scale = (inside.shape[1], inside.shape[0]), small[1] / inside.shape[0]
    near = _blurred(inside.astype(np.float32), sigma_px * scale, small, size)
    band = np.clip(4 * near * (1 - near), 0, 1)
    return np.stack([
        plane + band * (_blurred(plane, sigma_px * scale, small, size) - plane) for plane in weights
    ]).astype(np.float32)  # fmt: skip


def _blurred(plane: Plane, sigma_px: float, small: tuple[int, int], size: tuple[int, int]) -> Plane:
    coarse = cv2.GaussianBlur(cv2.resize(plane, small, interpolation=cv2.INTER_AREA), (0, 0), sigma_px)
    return np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR), np.float32)


def mix(weights: Weights, values: NDArray[np.float32]) -> Plane:
    """Weighted sum of `values`, float32 (keys + 1,): float32 (h, w).

    Summed in a loop, since matrix products round differently from processor to processor.
    """
    out = np.zeros(weights.shape[1:], np.float32)
    for weight, value in zip(weights, values, strict=True):
        out += weight * value
    return out
