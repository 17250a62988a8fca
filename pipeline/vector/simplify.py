"""Stronger smoothing of the borders that divide mere shading, where the picture has no edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.vector.borders import Borders, Positions
from pipeline.vector.smoothing import diffusion_steps, neighbours_of

FIXED_FROM, FREE_BELOW = np.float32(9), np.float32(5)
"""Contrast across a border, 8-bit CIELAB levels: from the first on its nodes stay, below the second they are smoothed
fully, and in between in proportion."""
_SIGMA_PX = 2.5
"""Standard deviation of the average of the contrast along borders, px."""


def simplify_borders(
    borders: Borders, lab: NDArray[np.uint8], reach_px: int, sigma_px: float, limit_px: float
) -> Borders:
    """Borders that divide a gradient, smoothed along their length.

    Regions divide the shading of a wall or a sky where its noise crosses a threshold: such a border is ragged, and a
    painter would draw one curve. Nodes with contrast across the border stay where they are.

    Args:
        borders: smoothed (`smooth_borders`).
        lab: uint8 (height, width, 3), 8-bit CIELAB of the frame.
        reach_px: distance from the border, on either side, at which colours are compared, px of the label map.
        sigma_px: standard deviation of the smoothing along borders without contrast, px.
        limit_px: the smoothing moves no node further than this along either axis, px.
    """
    neighbours, inverse_degrees = neighbours_of(borders)
    contrast = _contrast(borders.lattice, borders.edges, lab, reach_px)
    contrast = _averaged(contrast, neighbours, inverse_degrees, diffusion_steps(_SIGMA_PX))
    weights = _weights(contrast, borders.lattice, np.array(borders.size))
    positions = borders.positions.copy()
    _relax(positions, weights, neighbours, inverse_degrees, diffusion_steps(sigma_px), np.float32(limit_px))
    return Borders(positions, borders.lattice, borders.edges, borders.rows, borders.size)


@kernel
def _contrast(
    lattice: NDArray[np.int32], edges: NDArray[np.void], lab: NDArray[np.uint8], reach: int
) -> NDArray[np.float32]:
    """float32 (nodes,): the largest distance of the colours on both sides of a node's edges, 8-bit CIELAB levels."""
    height, width = lab.shape[0], lab.shape[1]
    contrast = np.zeros(lattice.shape[0], np.float32)
    for k in range(edges.shape[0]):
        if edges[k]["right"] == 0:
            continue
        a, b = edges[k]["start"], edges[k]["end"]
        x, y = lattice[a, 0], lattice[a, 1]
        if lattice[b, 0] == x:
            one, other = lab[y, max(x - reach, 0)], lab[y, min(x + reach - 1, width - 1)]
        else:
            one, other = lab[max(y - reach, 0), x], lab[min(y + reach - 1, height - 1), x]
        square = np.float32(0)
        for c in range(3):
            difference = np.float32(one[c]) - np.float32(other[c])
            square += difference * difference
        distance = np.sqrt(square)
        contrast[a] = max(contrast[a], distance)
        contrast[b] = max(contrast[b], distance)
    return contrast


@kernel
def _averaged(
    values: NDArray[np.float32], neighbours: NDArray[np.int32], inverse_degrees: NDArray[np.float32],
    steps: NDArray[np.float32],
) -> NDArray[np.float32]:  # fmt: skip
    now, then = values.copy(), np.empty_like(values)
    for step in steps:
        for n in range(now.shape[0]):
            a, b, c, d = neighbours[n, 0], neighbours[n, 1], neighbours[n, 2], neighbours[n, 3]
            here = now[n]
            around = (now[a] - here) + (now[b] - here) + (now[c] - here) + (now[d] - here)
            then[n] = here + step * inverse_degrees[n] * around
        now, then = then, now
    return now


@kernel
def _weights(contrast: NDArray[np.float32], lattice: NDArray[np.int32], size: NDArray[np.int64]) -> NDArray[np.float32]:
    """float32 (nodes,): 1 = smoothed fully, 0 = stays: on an edge, and on the frame's border."""
    weights = np.zeros_like(contrast)
    for n in range(contrast.shape[0]):
        if 0 < lattice[n, 0] < size[0] and 0 < lattice[n, 1] < size[1]:
            weights[n] = min(max((FIXED_FROM - contrast[n]) / (FIXED_FROM - FREE_BELOW), np.float32(0)), np.float32(1))
    return weights


@kernel
def _relax(
    positions: Positions, weights: NDArray[np.float32], neighbours: NDArray[np.int32],
    inverse_degrees: NDArray[np.float32], steps: NDArray[np.float32], limit: np.float32,
) -> None:  # fmt: skip
    """Diffuse the nodes whose weight is above 0 along the borders, in place."""
    free = np.empty(positions.shape[0], np.int32)
    count = 0
    for n in range(positions.shape[0]):
        if weights[n] > 0:
            free[count] = n
            count += 1
    before, moved = positions.copy(), np.empty_like(positions)
    for step in steps:
        for k in range(count):
            n = free[k]
            share = step * inverse_degrees[n] * weights[n]
            a, b, c, d = neighbours[n, 0], neighbours[n, 1], neighbours[n, 2], neighbours[n, 3]
            for axis in range(2):
                here = positions[n, axis]
                around = (positions[a, axis] - here) + (positions[b, axis] - here)
                around += (positions[c, axis] - here) + (positions[d, axis] - here)
                moved[k, axis] = here + share * around
        for k in range(count):
            positions[free[k], 0], positions[free[k], 1] = moved[k, 0], moved[k, 1]
    for n in free[:count]:
        for axis in range(2):
            place = before[n, axis]
            positions[n, axis] = min(max(positions[n, axis], place - limit), place + limit)
