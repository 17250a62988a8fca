"""Fair curves: straight where their points lie on a line, smooth where they do not, with sharp corners.

Each point moves onto the line that fits the longest part of its curve around it within a tolerance. Parts that begin or
end at the point are tried, too, so that a straight line stays straight up to a corner.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.lines.linking import Index


class FairParams(NamedTuple):
    """Constants of fairing."""

    reaches: tuple[int, ...] = (64, 40, 24, 14, 8, 5, 3)
    """Numbers of points on either side of a point that are fitted, from the longest part to the shortest."""
    tolerance_px: float = 0.28
    """Root mean square distance of the points of a part from their line."""
    passes: int = 6
    """Passes of the low-pass filter (1, 2, 1) / 4, which smooths the transition between parts."""


FAIR = FairParams()


def fair(places: NDArray[np.float32], starts: Index) -> NDArray[np.float32]:
    """The positions of the points of fair curves, float32 (m, 2), px.

    Args:
        places: float32 (m, 2), x and y of the points of all curves, px.
        starts: int32 (curves + 1,): curve i is places[starts[i]:starts[i + 1]].
    """
    out = np.empty_like(places)
    _fair(places, starts, out)
    return out


@kernel
def _fair(places: NDArray[np.float32], starts: Index, out: NDArray[np.float32]) -> None:
    for k in range(starts.size - 1):
        begin, end = starts[k], starts[k + 1]
        curve = places[begin:end]
        sums = _sums(curve)
        fitted = out[begin:end]
        for i in range(end - begin):
            _fit(curve, sums, i, fitted)
        moved = fitted.copy()
        for _ in range(FAIR.passes):
            for i in range(1, end - begin - 1):
                for axis in range(2):
                    moved[i, axis] = (
                        fitted[i - 1, axis] + np.float32(2) * fitted[i, axis] + fitted[i + 1, axis]
                    ) * np.float32(0.25)
            fitted[:] = moved


@kernel
def _sums(curve: NDArray[np.float32]) -> NDArray[np.float64]:
    """Running sums of x, y, xx, xy, yy relative to the first point: float64 (n + 1, 5)."""
    out = np.zeros((len(curve) + 1, 5))
    for i in range(len(curve)):
        x, y = np.float64(curve[i, 0] - curve[0, 0]), np.float64(curve[i, 1] - curve[0, 1])
        out[i + 1, 0], out[i + 1, 1] = out[i, 0] + x, out[i, 1] + y
        out[i + 1, 2], out[i + 1, 3], out[i + 1, 4] = out[i, 2] + x * x, out[i, 3] + x * y, out[i, 4] + y * y
    return out


@kernel
def _fit(curve: NDArray[np.float32], sums: NDArray[np.float64], i: int, out: NDArray[np.float32]) -> None:
    """Write the place of point i on the line of the longest part that fits."""
    last = len(curve) - 1
    out[i] = curve[i]
    for reach in FAIR.reaches:
        least = FAIR.tolerance_px * FAIR.tolerance_px
        found = False
        for way in range(3):
            a, b = (i - reach, i + reach) if way == 0 else ((i - 2 * reach, i) if way == 1 else (i, i + 2 * reach))
            a, b = max(a, 0), min(b, last)
            if b - a < 3 or (way > 0 and found):
                continue
            error = _project(curve, sums, i, a, b, least, out)
            if error < least:
                least, found = error, way == 0 or found
                if way > 0:
                    least = error
        if least < FAIR.tolerance_px * FAIR.tolerance_px:
            return


@kernel
def _project(
    curve: NDArray[np.float32], sums: NDArray[np.float64], i: int, a: int, b: int, least: float,
    out: NDArray[np.float32],
) -> float:  # fmt: skip
    """Mean squared distance of the points [a, b] from their line; if below `least`, point i is moved onto it."""
    count = float(b - a + 1)
    mean_x, mean_y = (sums[b + 1, 0] - sums[a, 0]) / count, (sums[b + 1, 1] - sums[a, 1]) / count
    xx = (sums[b + 1, 2] - sums[a, 2]) / count - mean_x * mean_x
    xy = (sums[b + 1, 3] - sums[a, 3]) / count - mean_x * mean_y
    yy = (sums[b + 1, 4] - sums[a, 4]) / count - mean_y * mean_y
    half = (xx - yy) / 2
    root = np.sqrt(half * half + xy * xy)
    error: float = (xx + yy) / 2 - root
    if error >= least or root == 0:
        return error
    dx, dy = (half + root, xy) if half > 0 else (xy, root - half)
    square = dx * dx + dy * dy
    x, y = curve[i, 0] - curve[0, 0] - mean_x, curve[i, 1] - curve[0, 1] - mean_y
    along = (x * dx + y * dy) / square
    out[i, 0] = np.float32(curve[0, 0] + mean_x + along * dx)
    out[i, 1] = np.float32(curve[0, 1] + mean_y + along * dy)
    return error
