"""Robust fit of a global motion to point pairs: translation, affine map or homography, by the number of points."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.kernels.jit import kernel

Homography: TypeAlias = NDArray[np.float64]
"""float64 (3, 3), acts on homogeneous coordinates (x, y, 1), px."""
Points: TypeAlias = NDArray[np.floating]
"""(n, 2): (x, y), px."""

IDENTITY: Homography = np.eye(3)
IDENTITY.setflags(write=False)
MOST_PERSPECTIVE = 2.0
"""Largest change of scale by perspective between two frames, within the rectangle of a patch."""
MOST = 1500
"""Largest number of points used by a fit; more points are subsampled evenly."""


def apply(matrix: Homography, points: Points) -> NDArray[np.float64]:
    """Map points (..., 2) by the homography."""
    x, y = points[..., 0], points[..., 1]
    a = matrix
    scale = 1 / (a[2, 0] * x + a[2, 1] * y + a[2, 2])
    across, down = a[0, 0] * x + a[0, 1] * y + a[0, 2], a[1, 0] * x + a[1, 1] * y + a[1, 2]
    return np.stack([across * scale, down * scale], axis=-1)


def deviation(flow: NDArray[np.float32], matrix: Homography) -> NDArray[np.float32]:
    """Distance between a flow, float32 (h, w, 2), and the homography's motion at each pixel: float32 (h, w), px."""
    out = np.empty(flow.shape[:2], np.float32)
    _deviation(flow, np.ascontiguousarray(matrix), out)
    return out


@kernel
def _deviation(flow: NDArray[np.float32], m: Homography, out: NDArray[np.float32]) -> None:
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            scale = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
            across = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale - x - flow[y, x, 0]
            down = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale - y - flow[y, x, 1]
            out[y, x] = np.sqrt(across * across + down * down)


def lattice(shape: tuple[int, int], origin: tuple[int, int] = (0, 0)) -> NDArray[np.float32]:
    """Positions (x, y) of the pixels of a rectangle, float32 (h, w, 2); `origin` is its top left pixel's (x, y)."""
    x = np.arange(shape[1], dtype=np.float32) + np.float32(origin[0])
    y = np.arange(shape[0], dtype=np.float32) + np.float32(origin[1])
    return np.dstack(np.meshgrid(x, y)).astype(np.float32)


def fit(
    source: Points, target: Points, *, weights: AnyArray | None = None, noise_px: float = 0.25, rounds: int = 6,
    start: Homography | None = None, over: tuple[int, int, int, int] | None = None,
) -> Homography:  # fmt: skip
    """Fit a homography from `source` to `target`, robust to outliers.

    The model depends on the points: the identity for fewer than 4; a translation (median) for fewer than 12 or a spread
    of a few px; an affine map for fewer than 200, since the perspective of a small region is ill-conditioned.

    Args:
        source, target: (n, 2), px.
        weights: (n,) >= 0; None = 1.
        noise_px: residual at which a point's weight begins to fall (Geman and McClure).
        rounds: iterations of reweighted least squares.
        start: initial estimate, from which the first weights are computed; None = `weights` alone.
        over: rectangle in which the map is used, (left, top, right, bottom), px. Points in a corner of it say little
            about the perspective of the rest: if it magnifies by more than `MOST_PERSPECTIVE`, the map is affine.
    """
    n = len(source)
    if n < 4:
        return IDENTITY
    pick = np.linspace(0, n - 1, min(n, MOST)).astype(np.intp)
    p, q = np.asarray(source, np.float64)[pick], np.asarray(target, np.float64)[pick]
    base = np.ones(len(pick)) if weights is None else np.asarray(weights, np.float64)[pick]
    spread = np.ptp(p, axis=0).min()
    if n < 12 or spread < 4 or base.sum() <= 0:
        return shift(np.median(q - p, axis=0))
    scale = max(float(np.ptp(p, axis=0).max()) / 2, 1.0)
    middle = p.mean(axis=0)
    matrix = np.array([[1 / scale, 0, -middle[0] / scale], [0, 1 / scale, -middle[1] / scale], [0, 0, 1]])
    u, v = (p - middle) / scale, (q - middle) / scale
    share, found = base, IDENTITY
    if start is not None:
        found = matrix @ start @ np.linalg.inv(matrix)
        share = base * _doubt(u, v, found, scale, noise_px)
    first = share
    for affine in (n < 200 or spread < 24, True):
        share = first
        for _ in range(rounds):
            found = _solve(u, v, share, affine=affine)
            share = base * _doubt(u, v, found, scale, noise_px)
        if over is None or _is_moderate(found, (np.reshape(over, (2, 2)) - middle) / scale):
            break
    return np.asarray(np.linalg.inv(matrix) @ found @ matrix)


def dominant(source: Points, target: Points, noise_px: float = 0.5) -> Homography:
    """Fit the homography with the most inliers, which may be fewer than half of the points: RANSAC, then `fit`."""
    if len(source) < 12:
        return fit(source, target)
    pick = np.linspace(0, len(source) - 1, min(len(source), MOST)).astype(np.intp)
    p, q = np.asarray(source, np.float64)[pick], np.asarray(target, np.float64)[pick]
    found, _ = cv2.findHomography(p, q, cv2.RANSAC, 2 * noise_px, maxIters=400)
    if found is None or not np.isfinite(found).all():
        return fit(source, target)
    return fit(p, q, start=found / found[2, 2], noise_px=noise_px)


def shift(vector: Points) -> Homography:
    """A translation by (x, y)."""
    return np.array([[1.0, 0, vector[0]], [0, 1.0, vector[1]], [0, 0, 1]])


def _doubt(u: Points, v: Points, matrix: Homography, scale: float, noise_px: float) -> NDArray[np.float64]:
    """Geman-McClure weight of each point by its residual: float64 (n,), 0..1."""
    out = np.empty(len(u))
    _weigh(u, v, np.ascontiguousarray(matrix), (scale / noise_px) ** 2, out)
    return out


def _is_moderate(matrix: Homography, corners: NDArray[np.float64]) -> bool:
    """Whether the perspective changes the scale by at most `MOST_PERSPECTIVE` in a rectangle, (2, 2) corners."""
    (left, top), (right, bottom) = corners
    depths = [matrix[2] @ (x, y, 1.0) for x in (left, right) for y in (top, bottom)]
    return bool(min(depths) * MOST_PERSPECTIVE >= 1 and max(depths) <= MOST_PERSPECTIVE)


RIDGE = np.array([1, 1, 0.01, 1, 1, 0.01, 30, 30.0])
"""Relative regularisation of each coefficient towards the identity: weak for translation, strong for perspective."""


def _solve(u: Points, v: Points, share: NDArray[np.float64], *, affine: bool) -> Homography:
    """Weighted least squares of the linear equations, normalised points; ridge towards the identity."""
    size = 6 if affine else 8
    normal, pull = np.zeros((8, 8)), np.zeros(8)
    _add_up(u, v, share, size, normal, pull)
    ridge = 1e-4 * max(float(share.sum()), 1e-6) * RIDGE
    start = np.array([1.0, 0, 0, 0, 1, 0, 0, 0])
    out = np.eye(3).ravel()
    out[:size] = np.linalg.solve((normal + np.diag(ridge))[:size, :size], (pull + ridge * start)[:size])
    return out.reshape(3, 3)


@kernel
def _weigh(u: Points, v: Points, m: Homography, scale2: float, out: NDArray[np.float64]) -> None:
    for n in range(len(out)):
        x, y = u[n, 0], u[n, 1]
        depth = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
        across = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * depth - v[n, 0]
        down = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * depth - v[n, 1]
        trust = 1.0 + (across * across + down * down) * scale2
        out[n] = 1.0 / (trust * trust)


@kernel
def _add_up(
    u: Points, v: Points, share: NDArray[np.float64], size: int, normal: NDArray[np.float64],
    pull: NDArray[np.float64],
) -> None:  # fmt: skip
    """Accumulate the normal equations in a fixed order; a multithreaded library may sum in varying order."""
    across, down = np.zeros(8), np.zeros(8)
    across[2] = down[5] = 1.0
    for n in range(len(share)):
        across[0] = down[3] = u[n, 0]
        across[1] = down[4] = u[n, 1]
        across[6], across[7] = -v[n, 0] * u[n, 0], -v[n, 0] * u[n, 1]
        down[6], down[7] = -v[n, 1] * u[n, 0], -v[n, 1] * u[n, 1]
        for i in range(size):
            for j in range(size):
                normal[i, j] += share[n] * (across[i] * across[j] + down[i] * down[j])
            pull[i] += share[n] * (across[i] * v[n, 0] + down[i] * v[n, 1])


__all__ = ["IDENTITY", "Homography", "apply", "deviation", "dominant", "fit", "lattice", "shift"]
