"""Curved strokes: follow an orientation field from each seed, and stop where the picture's colour turns."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.segmentation.jit import kernel
from pipeline.strokes.brush import Brush, Canvas, Direction, Strokes, discs
from pipeline.strokes.seeds import Points, Seeds, sample

MAX_POINTS = 48
"""Points of the longest stroke; longer ones take longer steps."""

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)


def gradient_normals(gray: Plane) -> Direction:
    """Across the gray gradient, as Hertzmann's strokes run: (cos 2a, sin 2a), (0, 0) where the gradient is 0.

    Args:
        gray: float32 (h, w), smoothed to the size of the strokes.

    Source: hertzmann1998painterly, section 2.2.
    """
    dx = cv2.Sobel(gray, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE)
    dy = cv2.Sobel(gray, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE)
    square = dx * dx + dy * dy
    scale = 1 / np.maximum(square, np.float32(1e-12))
    return np.dstack([(dy * dy - dx * dx) * scale, -2 * dx * dy * scale]).astype(np.float32)


def trace(
    seeds: Seeds, field: Direction, brush: Brush, aims: NDArray[np.float32], *, reference: Frame | None = None,
    canvas: Canvas | None = None, edge: float = 90.0, min_length: float = 0.25, curvature: float = 1.0,
    both: bool = True, seed: int = 0,
) -> Strokes:  # fmt: skip
    """Strokes along the field through the seeds, each half of its length to either side.

    Args:
        field: float32 (h, w, 2), (cos 2a, sin 2a) of any length; where it is (0, 0) a stroke goes straight on.
        aims: float32 (n, 3), RGB 0..255, the colours that the strokes stand for.
        reference: uint8 (h, w, 3), what is painted; with it a stroke ends where its colour no longer fits: further
            than `edge` from the picture's (Euclidean in RGB) ...
        canvas: float32 (h, w, 7): ... or further from it than what is on the canvas already.
        min_length: part of a stroke's length that it has in any case, 0..1, save at an edge and the picture's border.
        curvature: 1 = follow the field, towards 0 = stay straight (the paper's f_c).
        both: False grows a stroke from its seed in one direction only.
        seed: of the jitter of their colours.

    Source: hertzmann1998painterly, section 2.2 (steps of a radius, curvature filter, ends by colour); hays2004image,
    section 4 (both ways along an orientation field). Departure: `edge` holds within `min_length` too, so that strokes
    do not leave a silhouette.
    """
    return draw_out(
        discs(seeds, brush, aims, seed), sample(brush.length_px, seeds.xy), field, reference=reference, canvas=canvas,
        edge=edge, min_length=min_length, curvature=curvature, both=both,
    )  # fmt: skip


def draw_out(
    starts: Strokes, length_px: NDArray[np.float32], field: Direction, *, reference: Frame | None = None,
    canvas: Canvas | None = None, edge: float = 90.0, min_length: float = 0.25, curvature: float = 1.0,
    both: bool = True,
) -> Strokes:  # fmt: skip
    """`trace` for strokes that have their paint already.

    Args:
        starts: one point a stroke, in the picture (see `discs`).
        length_px: float32 (n,), from tip to tip.
    """
    guide = np.zeros((1, 1, 3), np.uint8) if reference is None else reference
    under = np.zeros((1, 1, 7), np.float32) if canvas is None else canvas
    points, counts = np.empty((len(starts), MAX_POINTS, 2), np.float32), np.empty(len(starts), np.int32)
    _trace(
        np.ascontiguousarray(starts.points[:, 0]), field, starts.radius_px, length_px, starts.aims, guide, under,
        reference is not None, canvas is not None, np.float32(edge * edge), np.float32(min_length),
        np.float32(curvature), both, points, counts,
    )  # fmt: skip
    longest = int(counts.max(initial=1))
    return replace(starts, points=np.ascontiguousarray(points[:, :longest]), counts=counts)


@kernel
def tangent(u: np.float32, v: np.float32, back_x: np.float32, back_y: np.float32) -> tuple[np.float32, np.float32]:
    """Unit vector of the angle a of (cos 2a, sin 2a) * length, of the two the one nearer (back_x, back_y).

    By half-angle formulas, which round alike on every processor. Without direction it is (back_x, back_y).
    """
    length = np.sqrt(u * u + v * v)
    if length <= np.float32(1e-6):
        return back_x, back_y
    scale = _HALF / length
    large = np.sqrt((length + abs(u)) * scale)
    small = v * scale / large
    x, y = (large, small) if u >= _ZERO else (small, large)
    if x * back_x + y * back_y < _ZERO:
        return -x, -y
    return x, y


@kernel
def _trace(
    xy: Points, field: Direction, radius: NDArray[np.float32], length: NDArray[np.float32],
    aims: NDArray[np.float32], reference: Frame, canvas: Canvas, guided: bool, covered: bool, edge2: np.float32,
    min_length: np.float32, curvature: np.float32, both: bool, points: NDArray[np.float32], counts: NDArray[np.int32],
) -> None:  # fmt: skip
    height, width = field.shape[:2]
    most = points.shape[1] // 2 - 1 if both else points.shape[1] - 1
    line = np.empty((2, points.shape[1], 2), np.float32)
    for k in range(len(xy)):
        reach = length[k] * (_HALF if both else _ONE)
        steps = int(np.ceil(reach / max(radius[k], _ONE)))
        steps = max(min(steps, most), 1)
        step = reach / np.float32(steps)
        ends = np.zeros(2, np.int32)
        if reach <= _ZERO:
            steps = 0
        for side in range(2 if both else 1):
            x, y = xy[k, 0], xy[k, 1]
            px, py = int(x + _HALF), int(y + _HALF)
            dx, dy = tangent(field[py, px, 0], field[py, px, 1], _ONE, _ZERO)
            if side:
                dx, dy = -dx, -dy
            for i in range(steps):
                # A midpoint step: half an Euler step finds the direction for the whole one.
                mx, my = x + _HALF * step * dx, y + _HALF * step * dy
                px, py = int(np.floor(mx + _HALF)), int(np.floor(my + _HALF))
                if px < 0 or py < 0 or px >= width or py >= height:
                    break
                tx, ty = tangent(field[py, px, 0], field[py, px, 1], dx, dy)
                tx = curvature * tx + (_ONE - curvature) * dx
                ty = curvature * ty + (_ONE - curvature) * dy
                norm = np.sqrt(tx * tx + ty * ty)
                if norm <= np.float32(1e-6):
                    break
                dx, dy = tx / norm, ty / norm
                nx, ny = x + step * dx, y + step * dy
                px, py = int(np.floor(nx + _HALF)), int(np.floor(ny + _HALF))
                if px < 0 or py < 0 or px >= width or py >= height:
                    break
                if guided:
                    own, other = _ZERO, _ZERO
                    for c in range(3):
                        wanted = np.float32(reference[py, px, c])
                        own += (wanted - aims[k, c]) * (wanted - aims[k, c])
                        if covered:
                            other += (wanted - canvas[py, px, 4 + c]) * (wanted - canvas[py, px, 4 + c])
                    enough = np.float32(i) >= min_length * np.float32(steps)
                    if own > edge2 or (covered and enough and other < own):
                        break
                x, y = nx, ny
                line[side, ends[side], 0] = x
                line[side, ends[side], 1] = y
                ends[side] += 1
        n = 0
        for i in range(ends[1] - 1, -1, -1):
            points[k, n] = line[1, i]
            n += 1
        points[k, n] = xy[k]
        n += 1
        for i in range(ends[0]):
            points[k, n] = line[0, i]
            n += 1
        counts[k] = n
