"""Low-pass filter for region borders, whose cost is proportional to the filter's width."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.vector.borders import Borders, Positions

_CYCLES = 2
"""Fewest cycles of fast explicit diffusion: the response of one cycle has negative parts, that of two has none."""
_LONGEST_CYCLE = 128.0
"""Largest sum of the steps of a cycle: rounding errors then stay below a thousandth of a pixel."""


def smooth_borders(borders: Borders, sigma_px: float, limit_px: float) -> Borders:
    """Low-pass filtered borders.

    Diffusion along the borders, which has the effect of a Gaussian: a step moves every node by a share of its distance
    to the mean of its neighbours. Shares as in fast explicit diffusion (grewenig2010box, section 3), so that the number
    of steps grows with `sigma_px`. The filter is applied twice, as 2 G - G^2, which keeps wide curves in place, so
    that small regions keep their area. Nodes on the frame's border slide along it.

    Args:
        sigma_px: standard deviation of the Gaussian, px of the label map; 0 = no smoothing.
        limit_px: smoothing moves no node further than this along either axis.
    """
    positions = borders.positions.copy()
    if sigma_px > 0:
        neighbours, inverse_degrees = neighbours_of(borders)
        fixed = _fixed(borders.lattice, np.array(borders.size))
        steps = diffusion_steps(sigma_px)
        once = _diffuse(positions, neighbours, inverse_degrees, fixed, steps)
        twice = _diffuse(once, neighbours, inverse_degrees, fixed, steps)
        _sharpen(once, twice, borders.positions, np.float32(limit_px), positions)
    return Borders(positions, borders.lattice, borders.edges, borders.rows, borders.size)


def neighbours_of(borders: Borders) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """int32 (nodes, 4): the neighbours of every node, itself in unused columns; float32: 1 / their number, or 0."""
    return _neighbours(borders.edges, len(borders.positions))


def diffusion_steps(sigma_px: float) -> NDArray[np.float32]:
    """Shares of the distance to the neighbours' mean by which nodes move, step by step; their sum is sigma_px^2.

    Large and small steps alternate: rounding errors grow in large steps, by 10^4 in a cycle of 20 steps in ascending
    order.
    """
    cycles = max(_CYCLES, math.ceil(sigma_px**2 / _LONGEST_CYCLE))
    time = sigma_px**2 / cycles
    count = max(1, math.ceil(math.sqrt(3 * time + 0.25) - 0.5))
    angles = math.pi * (2 * np.arange(count) + 1) / (4 * count + 2)
    cycle = 1 / (2 * np.cos(angles) ** 2)
    alternating = np.empty_like(cycle)
    alternating[::2], alternating[1::2] = cycle[::-1][: (count + 1) // 2], cycle[: count // 2]
    return np.tile(alternating * (time / cycle.sum()), cycles).astype(np.float32)


@kernel
def _neighbours(edges: NDArray[np.void], count: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """See `neighbours_of`. Edges along the left side of the frame, with label 0 outside, do not count."""
    degrees = np.zeros(count, np.int32)
    neighbours = np.empty((count, 4), np.int32)
    for n in range(count):
        neighbours[n, :] = n
    for k in range(edges.shape[0]):
        if edges[k]["right"] != 0:
            a, b = edges[k]["start"], edges[k]["end"]
            neighbours[a, degrees[a]] = b
            neighbours[b, degrees[b]] = a
            degrees[a] += 1
            degrees[b] += 1
    inverse_degrees = np.zeros(count, np.float32)
    for n in range(count):
        if degrees[n] > 0:
            inverse_degrees[n] = np.float32(1) / np.float32(degrees[n])
    return neighbours, inverse_degrees


@kernel
def _fixed(lattice: NDArray[np.int32], size: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Bits of the coordinates that a node keeps: 1 = x, 2 = y."""
    fixed = np.zeros(lattice.shape[0], np.uint8)
    for n in range(lattice.shape[0]):
        for axis in range(2):
            if lattice[n, axis] == 0 or lattice[n, axis] == size[axis]:
                fixed[n] |= 1 << axis
    return fixed


@kernel
def _diffuse(
    positions: Positions, neighbours: NDArray[np.int32], inverse_degrees: NDArray[np.float32], fixed: NDArray[np.uint8],
    steps: NDArray[np.float32],
) -> Positions:  # fmt: skip
    now, then = positions.copy(), np.empty_like(positions)
    for step in steps:
        for n in range(now.shape[0]):
            x, y, share = now[n, 0], now[n, 1], inverse_degrees[n]
            a, b, c, d = neighbours[n, 0], neighbours[n, 1], neighbours[n, 2], neighbours[n, 3]
            # Unused columns contribute 0 to the sum of differences.
            across = (now[a, 0] - x) + (now[b, 0] - x) + (now[c, 0] - x) + (now[d, 0] - x)
            down = (now[a, 1] - y) + (now[b, 1] - y) + (now[c, 1] - y) + (now[d, 1] - y)
            then[n, 0] = x if fixed[n] & 1 else x + step * share * across
            then[n, 1] = y if fixed[n] & 2 else y + step * share * down
        now, then = then, now
    return now


@kernel
def _sharpen(
    once: Positions, twice: Positions, before: Positions, limit: np.float32, out: Positions
) -> None:  # fmt: skip
    """2 * `once` - `twice`, at most `limit` from `before`."""
    for n in range(out.shape[0]):
        for axis in range(2):
            place = before[n, axis]
            smooth = np.float32(2) * once[n, axis] - twice[n, axis]
            out[n, axis] = min(max(smooth, place - limit), place + limit)
