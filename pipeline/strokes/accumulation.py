"""Temporal accumulation: the mean of a painting and the previous paintings, advected along the motion.

The change of strokes between frames is partly motion, which advection follows, and partly random: streamlines bend
slightly, strokes end at another pixel, new strokes appear. The mean over a few frames reduces the random part. Where
nothing moves, all paintings are the same and no sharpness is lost.

Source: kagaya2011video, section 4.2, takes its advection from vanwijk2002image, whose pictures are blended over time
while they are advected. Departures: a few previous paintings are blended instead of all (an exponential mean would
make one long chain of dependent frames); advection follows the motion of the video; paintings are blended only where
they show the same surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame, Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.emboss import Painted


class AccumulationParams(NamedTuple):
    """Constants of temporal accumulation."""

    same: float = 39.0
    other: float = 65.0
    """Change of the mean colour, gray levels, see `changes`. Up to `same`, two pictures show the same surface; from
    `other` on, they show different ones."""
    small: float = 0.02
    large: float = 0.045
    weight: float = 2.2
    """Sides of two windows for mean colours, as fractions of the frame's shorter side: about a fine stroke and a
    hand. Then the factor on the change in the larger window, which small misalignments of texture do not affect."""
    torn: np.float32 = np.float32(0.75)
    """Difference of the flow between neighbouring pixels, px, from which on it does not follow one surface. It
    shrinks a leg that has moved far to a thin line on the wall behind it, which windows would take for a misaligned
    texture."""
    attention: np.float32 = np.float32(4)
    """Relative increase of a change at full attention. A hand, a small face or a mouth that follows late leaves a
    smear."""


ACCUMULATION = AccumulationParams()


_CELLS_AROUND = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Painting:
    """A painted frame with the data that aligns it to its neighbours.

    Attributes:
        paint: uint8 or uint16 (h, w, 3), such as `emboss` returns.
        picture: uint8 (h', w', 3), the picture that was painted, possibly smaller.
        back: float32 (h', w', 2), flow from this frame to the one before, px of `picture`; None = a shot begins.
        attention: float32, a grid of any size over the frame, 0..1: where a change counts up to 1 +
            ACCUMULATION.attention times; None = 0.
        coverage: float32 (h, w), 0..1, share of each pixel that is painted; None = 1.
    """

    paint: Painted
    picture: Frame
    back: Flow | None
    attention: Plane | None = None
    coverage: Plane | None = None


def accumulated_coverage(now: Painting, past: Sequence[Painting]) -> Plane | None:
    """The coverage of `accumulate`: that of the paintings, averaged with the same weights; None = 1."""
    if now.coverage is None:
        return None
    mean = accumulate(_coverage_as_paint(now), [_coverage_as_paint(before) for before in past])
    return np.asarray(mean[..., 0] / np.float32(65535), np.float32)


def _coverage_as_paint(painting: Painting) -> Painting:
    assert painting.coverage is not None
    plane = np.rint(painting.coverage * 65535).astype(np.uint16)
    return replace(painting, paint=np.dstack([plane] * 3))


def accumulate(now: Painting, past: Sequence[Painting]) -> Painted:
    """Average a painting with the previous ones where they show the same surface, (h, w, 3) of the same type.

    Args:
        past: paintings of the previous frames, latest first.
    """
    mean, weight = now.paint.copy(), np.ones(now.paint.shape[:2], np.float32)
    flow, step = None, now.back
    for before in past:
        if step is None:
            break
        flow = step if flow is None else _chained(flow, step)
        change = _with_attention(_surface_change(now.picture, before.picture, flow), now.attention)
        _add(before.paint, flow, change, mean, weight)
        step = before.back
    return mean


def _chained(flow: Flow, step: Flow) -> Flow:
    """Concatenate a flow with the `step` from the frame it leads to, to the one before: float32 (h, w, 2), px."""
    out = np.empty_like(flow)
    _chain(flow, step, out)
    return out


@kernel
def _chain(flow: Flow, step: Flow, out: Flow) -> None:
    height, width = flow.shape[:2]
    for y in range(height):
        for x in range(width):
            if flow[y, x, 0] == 0 and flow[y, x, 1] == 0:
                out[y, x, 0], out[y, x, 1] = flow[y, x, 0] + step[y, x, 0], flow[y, x, 1] + step[y, x, 1]
                continue
            left, right, top, bottom, a, b = _neighbours(flow[y, x, 0], flow[y, x, 1], y, x, height, width)
            for c in range(2):
                out[y, x, c] = flow[y, x, c] + _interpolated(step, left, right, top, bottom, a, b, c)


@kernel
def _neighbours(
    dx: np.float32, dy: np.float32, y: int, x: int, height: int, width: int
) -> tuple[int, int, int, int, np.float32, np.float32]:
    """The four pixels around (x + dx, y + dy), clamped to the picture.

    Returns: left, right column; top, bottom row; distance from the left column and from the top row, 0..1 px.
    """
    px = min(max(np.float32(x) + dx, np.float32(0)), np.float32(width - 1))
    py = min(max(np.float32(y) + dy, np.float32(0)), np.float32(height - 1))
    left, top = int(px), int(py)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    return left, right, top, bottom, px - np.float32(left), py - np.float32(top)


@kernel
def _add(paint: Painted, flow: Flow, change: Plane, mean: Painted, weight: Plane) -> None:
    """Average an earlier painting into the mean, in place.

    Args:
        paint: uint8 or uint16 (h, w, 3).
        flow: float32 (h', w', 2), flow to the earlier painting on a grid over the picture, px of that grid.
        change: float32 (h", w"), a grid over the picture, see `_surface_change`.
        mean, weight: the type of `paint`, (h, w, 3), and float32 (h, w): the weighted mean of paintings, and the sum of
            their weights.
    """
    height, width = weight.shape
    half, zero, one = np.float32(0.5), np.float32(0), np.float32(1)
    grow_x, grow_y = np.float32(width / flow.shape[1]), np.float32(height / flow.shape[0])
    columns, change_columns = np.empty((2, width), np.uintp), np.empty((2, width), np.uintp)
    across, change_across = np.empty(width, np.float32), np.empty(width, np.float32)
    for x in range(width):
        columns[0, x], columns[1, x], across[x] = _cells(x, width, flow.shape[1])
        change_columns[0, x], change_columns[1, x], change_across[x] = _cells(x, width, change.shape[1])
    # Pixels [starts[i], starts[i + 1]) are between the columns i and i + 1 of the flow.
    starts = np.full(flow.shape[1] + 1, width, np.intp)
    for x in range(width - 1, -1, -1):
        starts[columns[0, x]] = x
    for i in range(flow.shape[1] - 1, -1, -1):
        starts[i] = min(starts[i], starts[i + 1])
    flow_x, flow_y = np.empty(flow.shape[1], np.float32), np.empty(flow.shape[1], np.float32)
    moves = np.empty(flow.shape[1], np.bool_)
    changed = np.empty(change.shape[1], np.float32)
    shares, parts, there = np.empty(width, np.float32), np.empty(3 * width, np.float32), np.empty(3 * width, np.float32)
    for y in range(height):
        # Flow and change at this row, on the columns of their own grids.
        above, below, down = _cells(y, height, flow.shape[0])
        for x in range(flow.shape[1]):
            flow_x[x] = (flow[above, x, 0] + down * (flow[below, x, 0] - flow[above, x, 0])) * grow_x
            flow_y[x] = (flow[above, x, 1] + down * (flow[below, x, 1] - flow[above, x, 1])) * grow_y
            moves[x] = flow_x[x] != zero or flow_y[x] != zero
        above, below, down = _cells(y, height, change.shape[0])
        for x in range(change.shape[1]):
            changed[x] = change[above, x] + down * (change[below, x] - change[above, x])
        # Weight of the earlier painting: 1 for the same surface, 0 for another one.
        for x in range(width):
            first, second = changed[change_columns[0, x]], changed[change_columns[1, x]]
            change_here = first + change_across[x] * (second - first)
            shares[x] = min(
                max(
                    (np.float32(ACCUMULATION.other) - change_here)
                    * np.float32(1 / (ACCUMULATION.other - ACCUMULATION.same)),
                    zero,
                ),
                one,
            )
        # Colours of the earlier painting: those of this row, replaced where the flow is not 0.
        row, own = paint[y].reshape(-1), mean[y].reshape(-1)
        for i in range(3 * width):
            there[i] = np.float32(row[i])
        for i in range(flow.shape[1]):
            j = min(i + 1, flow.shape[1] - 1)
            if not moves[i] and not moves[j]:
                continue
            for x in range(starts[i], starts[i + 1]):
                dx, dy = (
                    flow_x[i] + across[x] * (flow_x[j] - flow_x[i]),
                    flow_y[i] + across[x] * (flow_y[j] - flow_y[i]),
                )
                px, py = np.float32(x) + dx, np.float32(y) + dy
                if px < zero or py < zero or px > np.float32(width - 1) or py > np.float32(height - 1):
                    shares[x] = zero
                if shares[x] > zero:
                    left, right, top, bottom, a, b = _neighbours(dx, dy, y, x, height, width)
                    for c in range(3):
                        there[3 * x + c] = _interpolated(paint, left, right, top, bottom, a, b, c)
        # Weighted mean. These loops vectorise.
        sums = weight[y]
        for x in range(width):
            sums[x] += shares[x]
            part = shares[x] / sums[x]
            parts[3 * x], parts[3 * x + 1], parts[3 * x + 2] = part, part, part
        for i in range(3 * width):
            value = np.float32(own[i])
            own[i] = np.int32(value + parts[i] * (there[i] - value) + half)


@kernel
def _cells(at: int, size: int, cells: int) -> tuple[int, int, np.float32]:
    """The two cells whose centres enclose the centre of pixel `at`, and the pixel's distance from the first centre, in
    cells. `cells` cells cover `size` px."""
    place = min(max((at + 0.5) * cells / size - 0.5, 0.0), cells - 1.0)
    first = int(place)
    return first, min(first + 1, cells - 1), np.float32(place - first)


def changes(now: NDArray[np.float32], before: NDArray[np.float32], attention: Plane | None = None) -> Plane:
    """Change of the mean colour around each pixel, maximum over the channels: float32 (h, w), gray levels.

    Args:
        now, before: float32 (h, w, 3); `before` is already aligned to `now`.
        attention: increases the change, see `Painting`.
    """
    size = (now.shape[1], now.shape[0])
    half = (max(1, size[0] // 2), max(1, size[1] // 2))
    difference = np.asarray(cv2.resize(now - before, half, interpolation=cv2.INTER_AREA), np.float32)
    found = np.asarray(cv2.resize(_largest_change(difference), size, interpolation=cv2.INTER_LINEAR), np.float32)
    return _with_attention(found, attention)


def _with_attention(change: Plane, attention: Plane | None) -> Plane:
    """The change of colour, float32 (h, w), increased where attention is paid, see `Painting`; modified in place."""
    if attention is not None:
        size = (change.shape[1], change.shape[0])
        change *= 1 + ACCUMULATION.attention * np.asarray(
            cv2.resize(attention, size, interpolation=cv2.INTER_LINEAR), np.float32
        )
    return change


def _largest_change(difference: NDArray[np.float32]) -> Plane:
    """Largest change in either window, for a difference float32 (h, w, 3): float32 (h, w), gray levels."""
    side = min(difference.shape[:2])
    small, large = (
        _mean_change(difference, max(3, round(part * side)) | 1) for part in (ACCUMULATION.small, ACCUMULATION.large)
    )
    return np.asarray(cv2.max(small, large * np.float32(ACCUMULATION.weight)), np.float32)


def _mean_change(difference: NDArray[np.float32], side: int) -> Plane:
    red, green, blue = (np.abs(cv2.boxFilter(plane, -1, (side, side))) for plane in cv2.split(difference))
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.float32)


def _surface_change(picture: Frame, before: Frame, flow: Flow) -> Plane:
    """`changes` between a picture and the earlier one at p + flow, at half of the size: float32 (h // 2, w // 2)."""
    height, width = picture.shape[:2]
    difference = np.empty((max(1, height // 2), max(1, width // 2), 3), np.float32)
    torn = np.empty(difference.shape[:2], np.float32)
    _mean_difference(picture, before, flow, difference, torn)
    return np.asarray(cv2.max(_largest_change(difference), cv2.dilate(torn, _CELLS_AROUND)), np.float32)


@kernel
def _mean_difference(picture: Frame, before: Frame, flow: Flow, out: NDArray[np.float32], torn: Plane) -> None:
    """Mean over each cell of `out` of the difference between the picture and the earlier one at p + flow; and its
    largest channel in the cells of `torn` where the flow is torn, 0 elsewhere."""
    height, width = picture.shape[:2]
    rows, columns = out.shape[:2]
    one, two, three = np.uintp(1), np.uintp(2), np.uintp(3)
    steps, now, past = flow.reshape(-1), picture.reshape(-1), before.reshape(-1)
    edges = np.empty(columns + 1, np.intp)
    for column in range(columns + 1):
        edges[column] = column * width // columns
    for row in range(rows):
        first_y, last_y = row * height // rows, (row + 1) * height // rows
        for column in range(columns):
            first_x, last_x = edges[column], edges[column + 1]
            red, green, blue = np.float32(0), np.float32(0), np.float32(0)
            origin = two * np.uintp(first_y * width + first_x)
            origin_x, origin_y, far = steps[origin], steps[origin + one], np.float32(0)
            for y in range(first_y, last_y):
                for x in range(first_x, last_x):
                    pixel = np.uintp(y * width + x)
                    place = three * pixel
                    dx, dy = steps[two * pixel], steps[two * pixel + one]
                    far = max(far, abs(dx - origin_x), abs(dy - origin_y))
                    if dx == 0 and dy == 0:
                        r = np.float32(np.int32(now[place]) - np.int32(past[place]))
                        g = np.float32(np.int32(now[place + one]) - np.int32(past[place + one]))
                        b = np.float32(np.int32(now[place + two]) - np.int32(past[place + two]))
                    else:
                        left, right, top, bottom, a, c = _neighbours(dx, dy, y, x, height, width)
                        r = np.float32(now[place]) - _interpolated(before, left, right, top, bottom, a, c, 0)
                        g = np.float32(now[place + one]) - _interpolated(before, left, right, top, bottom, a, c, 1)
                        b = np.float32(now[place + two]) - _interpolated(before, left, right, top, bottom, a, c, 2)
                    red, green, blue = red + r, green + g, blue + b
            share = np.float32(1) / np.float32((last_y - first_y) * (last_x - first_x))
            red, green, blue = red * share, green * share, blue * share
            out[row, column, 0], out[row, column, 1], out[row, column, 2] = red, green, blue
            torn[row, column] = max(abs(red), abs(green), abs(blue)) if far > ACCUMULATION.torn else np.float32(0)


@kernel
def _interpolated(
    image: Painted | Flow, left: int, right: int, top: int, bottom: int, a: np.float32, b: np.float32, channel: int
) -> np.float32:
    """A channel of an image or a flow, interpolated bilinearly between four pixels, see `_neighbours`."""
    above, below = np.float32(image[top, left, channel]), np.float32(image[bottom, left, channel])
    above += a * (np.float32(image[top, right, channel]) - above)
    below += a * (np.float32(image[bottom, right, channel]) - below)
    return above + b * (below - above)
