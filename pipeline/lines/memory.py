"""Strokes that follow those of the previous frame: a pen that draws the same line again.

Each stroke leaves marks on the pixels around it: its opacity, its width, and the straight line along it. A stroke of
the next frame looks, back along the flow, for such a mark, and moves a part of the way onto its line, so that noise
moves lines less. A stroke that has no successor fades out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel
from pipeline.lines.past import PastMotion, smooth_along
from pipeline.lines.pen import Ink, Strokes


class MemoryParams(NamedTuple):
    """Constants of the memory of strokes."""

    far_px: np.float32 = np.float32(1.5)
    """Distance from a line of the past from which it is another one, px."""
    least_cosine: np.float32 = np.float32(0.8)
    """The same for the cosine of the angle between the two."""
    unit: np.float32 = np.float32(127)
    distance_steps: np.float32 = np.float32(64)
    width_steps: np.float32 = np.float32(32)
    """Steps of a mark's direction, of its distance and of its half width, per unit and per px."""
    least_weight: np.float32 = np.float32(0.5)
    """Weight of a stroke's past where the frame has changed: lines fade in there, too."""
    faint: np.float32 = np.float32(0.1)
    """Opacity below which a stroke that fades out is gone."""


MEMORY = MemoryParams()


class Marks(NamedTuple):
    """What the strokes of a frame leave on the pixels around them.

    Attributes:
        opacity: uint8 (h, w), 0..255; 0 = no mark.
        lines: int8 (h, w, 4): unit vector across the stroke, x and y; distance of the stroke from the pixel's centre in
            that direction; half width (`MEMORY`).
    """

    opacity: Ink
    lines: NDArray[np.int8]


def leave_marks(strokes: Strokes, shape: tuple[int, int]) -> Marks:
    """The marks of strokes on the 3x3 pixels around each of their points.

    Args:
        shape: (height, width) of the plane, px.
    """
    marks = Marks(np.zeros(shape, np.uint8), np.zeros((*shape, 4), np.int8))
    _leave(strokes, marks)
    return marks


@kernel
def _leave(strokes: Strokes, marks: Marks) -> None:
    height, width = marks.opacity.shape
    steps = MEMORY.distance_steps
    for reach in (1, 0):  # the nearest point has the last word
        for k in range(strokes.starts.size - 1):
            first, last = strokes.starts[k], strokes.starts[k + 1] - 1
            for n in range(first, last + 1):
                x, y = strokes.places[n, 0], strokes.places[n, 1]
                nx, ny = across(strokes.places, n, first, last)
                opacity = np.uint8(np.float32(255) * strokes.opacities[n] + np.float32(0.5))
                for v in range(max(int(y) - reach, 0), min(int(y) + reach + 1, height)):
                    for u in range(max(int(x) - reach, 0), min(int(x) + reach + 1, width)):
                        marks.opacity[v, u] = max(marks.opacity[v, u], opacity)
                        dx, dy = x - np.float32(u) - np.float32(0.5), y - np.float32(v) - np.float32(0.5)
                        marks.lines[v, u, 0] = np.int8(np.rint(MEMORY.unit * nx))
                        marks.lines[v, u, 1] = np.int8(np.rint(MEMORY.unit * ny))
                        distance = np.rint(steps * (dx * nx + dy * ny))
                        marks.lines[v, u, 2] = np.int8(min(max(distance, np.float32(-127)), np.float32(127)))
                        wide = np.rint(MEMORY.width_steps * strokes.half_widths[n])
                        marks.lines[v, u, 3] = np.int8(min(wide, np.float32(127)))


@kernel
def across(places: NDArray[np.float32], n: int, first: int, last: int) -> tuple[np.float32, np.float32]:
    """Unit vector across a curve, with the points first..last, at point n."""
    a, b = max(n - 2, first), min(n + 2, last)
    dx, dy = places[b, 0] - places[a, 0], places[b, 1] - places[a, 1]
    length = max(np.sqrt(dx * dx + dy * dy), np.float32(1e-6))
    return -dy / length, dx / length


def follow_marks(strokes: Strokes, marks: Marks, motion: PastMotion) -> Strokes:
    """Strokes that are drawn again where those of the previous frame were: mixed with them in place, width and opacity.

    A stroke without a mark fades in.

    Args:
        strokes: px of the planes of `marks` and `motion`.
        motion: since the frame of the marks.
    """
    places, widths, opacities = strokes.places, strokes.half_widths.copy(), strokes.opacities.copy()
    shifts, normals = np.zeros(len(places), np.float32), np.zeros_like(places)
    _follow(strokes, marks, motion, shifts, normals, widths, opacities)
    smooth_along(shifts, strokes.starts)
    smooth_along(opacities, strokes.starts)
    return Strokes(places + shifts[:, None] * normals, widths, opacities, strokes.starts)


@kernel
def _follow(
    strokes: Strokes, marks: Marks, motion: PastMotion, shifts: NDArray[np.float32], normals: NDArray[np.float32],
    widths: NDArray[np.float32], opacities: NDArray[np.float32],
) -> None:  # fmt: skip
    height, width = marks.opacity.shape
    half = np.float32(0.5)
    for k in range(strokes.starts.size - 1):
        first, last = strokes.starts[k], strokes.starts[k + 1] - 1
        for n in range(first, last + 1):
            x, y = strokes.places[n, 0] - half, strokes.places[n, 1] - half
            column, row = min(max(int(np.rint(x)), 0), width - 1), min(max(int(np.rint(y)), 0), height - 1)
            fade = max(motion.weights[motion.residual[row, column]], MEMORY.least_weight)
            weight = fade * (np.float32(2) - fade)
            x, y = x - motion.flow[row, column, 0], y - motion.flow[row, column, 1]
            u, v = min(max(int(np.rint(x)), 0), width - 1), min(max(int(np.rint(y)), 0), height - 1)
            opacities[n] += fade * (np.float32(marks.opacity[v, u]) / np.float32(255) - opacities[n])
            normals[n, 0], normals[n, 1] = nx, ny = across(strokes.places, n, first, last)
            line = marks.lines[v, u]
            past_x, past_y = np.float32(line[0]) / MEMORY.unit, np.float32(line[1]) / MEMORY.unit
            cosine = past_x * nx + past_y * ny
            away = np.float32(line[2]) / MEMORY.distance_steps
            away -= (x - np.float32(u)) * past_x + (y - np.float32(v)) * past_y
            if abs(cosine) > MEMORY.least_cosine and abs(away) < MEMORY.far_px:
                shifts[n] = weight * away * (np.float32(1) if cosine > 0 else np.float32(-1))
                widths[n] += weight * (np.float32(line[3]) / MEMORY.width_steps - widths[n])


def fading_strokes(before: Strokes, marks: Marks, motion: PastMotion) -> Strokes:
    """The parts of the previous frame's strokes that are not drawn again, moved along the flow and fainter.

    Args:
        before: the strokes of the previous frame, px of the planes.
        marks: of this frame.
        motion: since the previous frame; where it has changed, nothing remains.
    """
    starts = np.zeros(len(before.places) // 2 + 1, np.int32)
    out = Strokes(
        np.empty_like(before.places), np.empty_like(before.half_widths), np.empty_like(before.opacities), starts
    )  # fmt: skip
    count = _fade_out(before, marks, motion, out)
    points = out.starts[count]
    return Strokes(out.places[:points], out.half_widths[:points], out.opacities[:points], out.starts[: count + 1])


@kernel
def _fade_out(before: Strokes, marks: Marks, motion: PastMotion, out: Strokes) -> int:
    """Write the faded parts of at least two points; returns their number."""
    height, width = marks.opacity.shape
    count = used = 0
    for k in range(before.starts.size - 1):
        for n in range(before.starts[k], before.starts[k + 1]):
            x, y = before.places[n, 0], before.places[n, 1]
            column, row = min(max(int(x), 0), width - 1), min(max(int(y), 0), height - 1)
            x, y = x + motion.flow[row, column, 0], y + motion.flow[row, column, 1]
            column, row = min(max(int(x), 0), width - 1), min(max(int(y), 0), height - 1)
            opacity = motion.weights[motion.residual[row, column]] * before.opacities[n]
            gone = opacity < MEMORY.faint or marks.opacity[row, column] > 0
            if not gone:
                out.places[used, 0], out.places[used, 1] = x, y
                out.half_widths[used], out.opacities[used] = before.half_widths[n], opacity
                used += 1
            if gone or n == before.starts[k + 1] - 1:
                if used - out.starts[count] > 1:
                    count += 1
                    out.starts[count] = used
                used = out.starts[count]
    return count
