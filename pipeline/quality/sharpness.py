"""Measures the width of edges in an image, in its own pixels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane

_REACH_PX, _STEP_PX = 8, 0.25
_STRONGEST_SHARE = 0.02
_LEAST_SLOPE, _LEAST_CONTRAST = 4.0, 12.0
"""Gray levels per px, and gray levels: weaker edges are texture or noise."""
_RISING = 0.2
"""Gray levels per px that a profile must rise to belong to its edge."""
_MAP_COLUMNS, _MAP_ROWS = 1024, 8192
"""OpenCV's remap accepts at most 32,767 rows and columns."""


def edge_widths(frame: Frame) -> NDArray[np.float64]:
    """Widths of the strongest edges: the distance in which lightness goes from 10 % to 90 % of the edge's contrast.

    The strongest 2 % of the gradient magnitudes, thinned to the maxima along the gradient, are sampled every quarter
    of a pixel across the edge. An ideal anti-aliased step has a width of about 1.0 px, a step blurred with a Gaussian
    of s px about 2.56 s.

    Args:
        frame: uint8 (height, width, 3).

    Returns:
        float64 (edges,), px; empty if the picture has no edges.
    """
    light = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    x, y, toward_x, toward_y = _crests(light)
    if not len(x):
        return np.zeros(0)
    offsets = np.arange(-_REACH_PX, _REACH_PX + _STEP_PX / 2, _STEP_PX)
    profiles = np.stack([_sample(light, x + d * toward_x, y + d * toward_y) for d in offsets], axis=1)
    return _widths(profiles)


def _crests(light: Plane) -> tuple[NDArray[np.float64], ...]:
    """Positions (x, y) of the strongest edges and the unit direction (x, y) in which lightness rises."""
    gx = cv2.Sobel(light, cv2.CV_32F, 1, 0, scale=1 / 8)
    gy = cv2.Sobel(light, cv2.CV_32F, 0, 1, scale=1 / 8)
    slope = np.hypot(gx, gy)
    strong = slope >= max(float(np.quantile(slope, 1 - _STRONGEST_SHARE)), _LEAST_SLOPE)
    inner = np.zeros_like(strong)
    inner[_REACH_PX:-_REACH_PX, _REACH_PX:-_REACH_PX] = True
    y, x = np.nonzero(strong & inner)
    here = slope[y, x]
    toward_x, toward_y = gx[y, x] / here, gy[y, x] / here
    ahead, behind = (_sample(slope, x + s * toward_x, y + s * toward_y) for s in (1, -1))
    crest = (here >= ahead) & (here > behind)
    return tuple(np.asarray(v[crest], dtype=np.float64) for v in (x, y, toward_x, toward_y))


def _sample(plane: Plane, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
    """Bilinear samples at any number of positions."""
    count = len(x)
    if not count:
        return np.zeros(0, np.float32)
    rows = -(-count // _MAP_COLUMNS)
    maps = [np.resize(v.astype(np.float32), (rows, _MAP_COLUMNS)) for v in (x, y)]
    parts = [
        cv2.remap(plane, maps[0][r : r + _MAP_ROWS], maps[1][r : r + _MAP_ROWS], cv2.INTER_LINEAR)
        for r in range(0, rows, _MAP_ROWS)
    ]
    return np.asarray(np.concatenate(parts).ravel()[:count])


def _widths(profiles: NDArray[np.float32]) -> NDArray[np.float64]:
    """10-90 % widths of profiles (edges, samples) that rise about their middle; edges of low contrast are left out."""
    count, samples = profiles.shape
    middle = samples // 2
    rising = np.diff(profiles, axis=1) > _RISING * _STEP_PX
    low = middle - _run_length(rising[:, :middle][:, ::-1])
    high = middle + _run_length(rising[:, middle:])
    rows = np.arange(count)
    foot, contrast = profiles[rows, low], profiles[rows, high] - profiles[rows, low]
    kept = contrast >= _LEAST_CONTRAST
    ends = [_crossing(profiles, low, foot + share * contrast) for share in (0.1, 0.9)]
    return np.asarray((ends[1] - ends[0])[kept] * _STEP_PX, dtype=np.float64)


def _run_length(rising: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Number of leading entries of each row that are true."""
    return np.asarray(np.logical_and.accumulate(rising, axis=1).sum(axis=1), dtype=np.intp)


def _crossing(
    profiles: NDArray[np.float32], start: NDArray[np.intp], level: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Position where each profile first reaches `level`, from sample `start` on: in samples, linearly interpolated."""
    count, samples = profiles.shape
    columns = np.arange(samples)
    reached = (profiles >= level[:, None]) & (columns >= start[:, None])
    above = np.maximum(reached.argmax(axis=1), 1)
    rows = np.arange(count)
    left, right = profiles[rows, above - 1], profiles[rows, above]
    return np.asarray(above - 1 + (level - left) / np.maximum(right - left, 1e-6), dtype=np.float64)
