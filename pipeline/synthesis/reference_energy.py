"""The energy function and one PatchMatch iteration in Numba: the specification of `patchmatch.cl`.

Uses the same operations in the same order as the kernel: integer sums lane by lane, a comparison after each pair of
rows, and float32 wherever the kernel has float. Absent terms are arrays of length 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.kernels.jit import kernel
from pipeline.strokes.random import philox
from pipeline.synthesis.energy import NO_DIRECTION, SCALE_SHIFT

Array = AnyArray
_NOWHERE = np.float32(-1e6)
_INFINITE = np.float32(3.0e38)
_UNIT = np.float32(5.9604645e-8)
_TWO, _ONE, _HALF, _QUARTER = np.float32(2), np.float32(1), np.float32(0.5), np.float32(0.25)
_RIBBON = 0x41BB0000


class Inputs(NamedTuple):
    """Array arguments of an iteration; absent terms are arrays of length 0."""

    offsets: Array
    target: Array
    field: Array
    bins: Array
    style: Array
    style_bins: Array
    usable: Array
    style_distance: Array
    weights: Array
    tap_positions: Array
    cosines: Array
    tap_weights: Array
    advected_colours: Array
    penalty: Array
    distance: Array
    advected: Array
    ribbons: Array
    fixed: Array
    before: Array


class Iteration(NamedTuple):
    """Scalar arguments of an iteration: the struct of this name in patchmatch.cl, and the shape of packed pixels."""

    coherence_limit: int
    coherence_weight: np.float32
    temporal_weight: np.float32
    kept_cost: np.float32
    line_limit: np.float32
    line_weight: np.float32
    jump: int
    search_px: np.float32
    ribbon_px: np.float32
    seed: int
    stream: int
    round: int
    channels: int
    pad: int


class Pixel(NamedTuple):
    """The pixel whose offset is improved: position and direction."""

    x: int
    y: int
    direction: int
    lanes: Array
    """Scratch memory for eight partial sums, int64."""


class StyleDirections(NamedTuple):
    """Directions of a style image, for `extrapolated_offset`.

    Attributes:
        bins: uint8 (height, width), direction of each style pixel; length 0 = offsets are not rotated.
        cosines: float32 (64, 2), cosine and sine of each rotation.
        width, height: size of the style image, px.
    """

    bins: Array
    cosines: Array
    width: int
    height: int


@kernel
def rotation_between(style_bins: Array, x: int, y: int, direction: int) -> int:
    """Index of the rotation, 0..63, from the pixel's `direction` to the style's direction at (x, y)."""
    if style_bins.size == 0:
        return 0
    style_direction = style_bins[y, x]
    if style_direction == NO_DIRECTION or direction == NO_DIRECTION:
        return 0
    return (int(style_direction) - int(direction)) & 63


@kernel
def extrapolated_offset(
    x: np.float32, y: np.float32, dx: np.float32, dy: np.float32, direction: int, style: StyleDirections
) -> tuple[np.float32, np.float32]:
    """Extrapolate the offset (x, y) of a pixel to the pixel at distance (dx, dy), px, by rotated translation."""
    if style.bins.size == 0:
        return x + dx, y + dy
    at_x = min(max(int(np.rint(x)), 0), style.width - 1)
    at_y = min(max(int(np.rint(y)), 0), style.height - 1)
    rotation = rotation_between(style.bins, at_x, at_y, direction)
    c, s = style.cosines[rotation, 0], style.cosines[rotation, 1]
    return x + (c * dx - s * dy), y + (s * dx + c * dy)


@kernel
def unit(word: int | np.unsignedinteger) -> np.float32:
    """Convert a 32-bit random word to float32 in [0, 1)."""
    return np.float32(np.uint64(word) >> np.uint64(8)) * _UNIT


@kernel
def _centre_cost(at_x: int, at_y: int, pixel: Pixel, inputs: Inputs, it: Iteration) -> np.float32:
    cost = np.float32(0)
    x, y = pixel.x, pixel.y
    if inputs.advected_colours.size:
        total = 0
        for c in range(3):
            off = int(inputs.style[at_y + it.pad, at_x + it.pad, c]) - int(inputs.advected_colours[y, x, c])
            total += off * off
        cost += it.temporal_weight * np.float32(total) if inputs.advected_colours[y, x, 3] else np.float32(0)
    if inputs.penalty.size:
        cost += inputs.penalty[at_y, at_x]
    if inputs.distance.size:
        difference = min(abs(inputs.distance[y, x] - inputs.style_distance[at_y, at_x]), it.line_limit)
        cost += it.line_weight * (difference * difference)
    return cost


@kernel
def _incoherence(at_x: int, at_y: int, rotation: int, pixel: Pixel, inputs: Inputs, coherence_limit: int) -> int:
    sum_, side = 0, inputs.tap_positions.shape[1]
    for row in range(side):
        for tap in range(side):
            ox = int(inputs.field[pixel.y + row, pixel.x + tap, 0]) - at_x - inputs.tap_positions[rotation, row, tap, 0]
            oy = int(inputs.field[pixel.y + row, pixel.x + tap, 1]) - at_y - inputs.tap_positions[rotation, row, tap, 1]
            ox, oy = min(max(ox, -255), 255), min(max(oy, -255), 255)
            sum_ += min(ox * ox + oy * oy, coherence_limit) * inputs.tap_weights[row, tap]
    return sum_


@kernel
def _patch_cost(at_x: int, at_y: int, limit: np.float32, pixel: Pixel, inputs: Inputs, it: Iteration) -> np.float32:
    cost = _centre_cost(at_x, at_y, pixel, inputs, it)
    if cost >= limit:
        return cost
    rotation = rotation_between(inputs.style_bins, at_x, at_y, pixel.direction)
    side = inputs.tap_positions.shape[1]
    radius, total, lanes = side // 2, 0, pixel.lanes
    lanes[:] = 0
    for out in range(radius + 1):
        for sign in range(1 if out == 0 else 2):
            row = radius + (out if sign else -out)
            for tap in range(side):
                sx = at_x + it.pad + inputs.tap_positions[rotation, row, tap, 0]
                sy = at_y + it.pad + inputs.tap_positions[rotation, row, tap, 1]
                for c in range(it.channels):
                    j = tap * it.channels + c
                    t = int(inputs.target[pixel.y + row, pixel.x + tap, c])
                    e = (t - int(inputs.style[sy, sx, c])) * int(inputs.weights[row, j])
                    lanes[(j & 15) >> 1] += e * e
        total = 0
        for k in range(8):
            total += lanes[k] >> SCALE_SHIFT
        if out and cost + np.float32(total) >= limit:
            return cost + np.float32(total)
    cost += np.float32(total)
    if it.coherence_weight > 0 and cost < limit:
        cost += it.coherence_weight * np.float32(_incoherence(at_x, at_y, rotation, pixel, inputs, it.coherence_limit))
    return cost


@kernel
def _candidates(pixel: Pixel, inputs: Inputs, it: Iteration, out: Array) -> int:
    """Write the candidate offsets of the neighbours and of the ribbons; returns their number.

    The advected offset is among them, unless it is preferred (`kept_cost` < 1) and compared separately.
    """
    height, width, _ = inputs.offsets.shape
    style_height, style_width = inputs.style.shape[0] - 2 * it.pad, inputs.style.shape[1] - 2 * it.pad
    style = StyleDirections(inputs.style_bins, inputs.cosines, style_width, style_height)
    x, y, count = pixel.x, pixel.y, 0
    if it.kept_cost >= 1 and inputs.advected_colours.size and inputs.advected[y, x, 0] > _NOWHERE:
        out[0] = inputs.advected[y, x]
        count = 1
    for k in range(8 if it.jump > 1 else 4):
        far = 1 if k < 4 else it.jump
        dx = -far if k & 3 == 0 else far if k & 3 == 1 else 0
        dy = -far if k & 3 == 2 else far if k & 3 == 3 else 0
        if not (0 <= x + dx < width and 0 <= y + dy < height):
            continue
        other = inputs.bins[y + dy, x + dx] if inputs.bins.size else NO_DIRECTION
        found = extrapolated_offset(
            inputs.offsets[y + dy, x + dx, 0], inputs.offsets[y + dy, x + dx, 1], np.float32(-dx), np.float32(-dy),
            other, style,
        )  # fmt: skip
        out[count, 0], out[count, 1] = found
        count += 1
    for k in range(2 if inputs.ribbons.size else 0):
        if inputs.ribbons[k, y, x, 0] <= _NOWHERE:
            continue
        key_words = philox(x, y, it.round, _RIBBON + k, it.seed, it.stream)
        rx = np.rint((unit(key_words[0]) * _TWO - _ONE) * it.ribbon_px)
        ry = np.rint((unit(key_words[1]) * _TWO - _ONE) * it.ribbon_px)
        out[count] = inputs.ribbons[k, y, x]
        out[count + 1, 0] = inputs.ribbons[k, y, x, 0] + np.float32(rx)
        out[count + 1, 1] = inputs.ribbons[k, y, x, 1] + np.float32(ry)
        count += 2
    return count


@kernel
def _best(pixel: Pixel, inputs: Inputs, it: Iteration, candidates: Array) -> tuple[np.float32, np.float32]:
    """The offset with the lowest cost among the current one, the candidates and the random search."""
    style_height, style_width = inputs.style.shape[0] - 2 * it.pad, inputs.style.shape[1] - 2 * it.pad
    x, y = pixel.x, pixel.y
    best_x, best_y = inputs.offsets[y, x, 0], inputs.offsets[y, x, 1]
    at_x = min(max(int(np.rint(best_x)), 0), style_width - 1)
    at_y = min(max(int(np.rint(best_y)), 0), style_height - 1)
    no_x, no_y = -1, -1
    best = _patch_cost(at_x, at_y, _INFINITE, pixel, inputs, it)
    if it.kept_cost < 1 and inputs.advected_colours.size and inputs.advected[y, x, 0] > _NOWHERE:
        cx, cy = inputs.advected[y, x, 0], inputs.advected[y, x, 1]
        tx, ty = int(np.rint(cx)), int(np.rint(cy))
        kept = tx == at_x and ty == at_y
        cost = it.kept_cost * (best if kept else _patch_cost(tx, ty, _INFINITE, pixel, inputs, it))
        if kept or cost < best:
            best, at_x, at_y, best_x, best_y = cost, tx, ty, cx, cy
        else:
            no_x, no_y = tx, ty
    count = _candidates(pixel, inputs, it, candidates)
    far_px, step, index = it.search_px, 0, 0
    key_words = philox(x, y, it.round, 0, it.seed, it.stream)
    while index < count or far_px >= _ONE:
        if index < count:
            cx, cy = candidates[index, 0], candidates[index, 1]
            index += 1
        else:
            second = step & 1
            if not second:
                key_words = philox(x, y, it.round, step >> 1, it.seed, it.stream)
            a, b = (key_words[2], key_words[3]) if second else (key_words[0], key_words[1])
            span = far_px * _HALF if second else far_px
            cx = np.float32(at_x + int(np.rint((unit(a) * _TWO - _ONE) * span)))
            cy = np.float32(at_y + int(np.rint((unit(b) * _TWO - _ONE) * span)))
            if second:
                far_px *= _QUARTER
            step += 1
        tx, ty = int(np.rint(cx)), int(np.rint(cy))
        if not (0 <= tx < style_width and 0 <= ty < style_height):
            continue
        if (tx == at_x and ty == at_y) or (tx == no_x and ty == no_y):
            continue
        if inputs.usable.size and not inputs.usable[ty, tx]:
            continue
        cost = _patch_cost(tx, ty, best, pixel, inputs, it)
        if cost < best:
            best, at_x, at_y, best_x, best_y = cost, tx, ty, cx, cy
        else:
            no_x, no_y = tx, ty
    return best_x, best_y


@kernel
def _settled(x: int, y: int, inputs: Inputs, jump: int) -> bool:
    """Whether the offsets of a pixel and of the pixels that propose candidates to it have not changed."""
    height, width, _ = inputs.offsets.shape
    for k in range(9 if jump > 1 else 5):
        far = 0 if k == 0 else 1 if k < 5 else jump
        dx = -far if k & 3 == 1 else far if k & 3 == 2 else 0
        dy = -far if k & 3 == 3 else far if k & 3 == 0 else 0
        if not (0 <= x + dx < width and 0 <= y + dy < height):
            continue
        now, then = inputs.offsets[y + dy, x + dx], inputs.before[y + dy, x + dx]
        if now[0] != then[0] or now[1] != then[1]:
            return False
    return True


@kernel
def improve(inputs: Inputs, it: Iteration, improved: Array) -> None:
    """One iteration over every pixel."""
    height, width, _ = inputs.offsets.shape
    lanes = np.zeros(8, np.int64)
    candidates = np.empty((16, 2), np.float32)
    for y in range(height):
        for x in range(width):
            if inputs.fixed.size and inputs.fixed[y, x, 0] > _NOWHERE:
                improved[y, x] = inputs.fixed[y, x]
                continue
            if inputs.before.size and _settled(x, y, inputs, it.jump):
                improved[y, x] = inputs.offsets[y, x]
                continue
            direction = int(inputs.bins[y, x]) if inputs.bins.size else int(NO_DIRECTION)
            pixel = Pixel(x, y, direction, lanes)
            improved[y, x, 0], improved[y, x, 1] = _best(pixel, inputs, it, candidates)
