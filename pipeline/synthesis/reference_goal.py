"""The goal function and an iteration of PatchMatch in Numba: the specification of `patchmatch.cl`.

The same operations in the same order: sums of whole numbers lane by lane, a comparison after each pair of rows, float32
where the kernel has float. Absent terms are arrays of length 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.segmentation.jit import kernel
from pipeline.strokes.random import philox
from pipeline.synthesis.goal import NO_DIRECTION, SCALE_SHIFT

Array = NDArray[Any]
_NOWHERE = np.float32(-1e6)
_INFINITE = np.float32(3.0e38)
_UNIT = np.float32(5.9604645e-8)
_TWO, _ONE, _HALF, _QUARTER = np.float32(2), np.float32(1), np.float32(0.5), np.float32(0.25)
_RIBBON = 0x41BB0000


@kernel
def turn_between(style_bins: Array, x: int, y: int, direction: int) -> int:
    """By which of the 64 turns the style is turned where a pixel of a direction shows the style's pixel (x, y)."""
    if style_bins.size == 0:
        return 0
    there = style_bins[y, x]
    if there == NO_DIRECTION or direction == NO_DIRECTION:
        return 0
    return (int(there) - int(direction)) & 63


@kernel
def carried(
    x: np.float32, y: np.float32, dx: np.float32, dy: np.float32, direction: int, style_bins: Array, cosines: Array,
    width: int, height: int,
) -> tuple[np.float32, np.float32]:  # fmt: skip
    """Where an offset would have a pixel (dx, dy) away."""
    if style_bins.size == 0:
        return x + dx, y + dy
    at_x = min(max(int(np.rint(x)), 0), width - 1)
    at_y = min(max(int(np.rint(y)), 0), height - 1)
    turn = turn_between(style_bins, at_x, at_y, direction)
    c, s = cosines[turn, 0], cosines[turn, 1]
    return x + (c * dx - s * dy), y + (s * dx + c * dy)


@kernel
def unit(word: Any) -> np.float32:
    """[0, 1) from a random word."""
    return np.float32(np.uint64(word) >> np.uint64(8)) * _UNIT


@kernel
def _goal(
    at_x: int, at_y: int, limit: np.float32, x: int, y: int, direction: int, target: Array, field: Array, style: Array,
    style_bins: Array, style_distance: Array, weights: Array, taps: Array, step_weights: Array, before: Array,
    penalty: Array, distance: Array, wanted: Array, wanted_weights: Array, numbers: Array, channels: int, pad: int,
    lanes: Array,
) -> np.float32:  # fmt: skip
    reach, coherence, steadiness = int(numbers[0]), numbers[1], numbers[2]
    cost = np.float32(0)
    if before.size:
        total = 0
        for c in range(3):
            off = int(style[at_y + pad, at_x + pad, c]) - int(before[y, x, c])
            total += off * off
        cost += steadiness * np.float32(total) if before[y, x, 3] else np.float32(0)
    if penalty.size:
        cost += penalty[at_y, at_x]
    if distance.size:
        apart = min(abs(distance[y, x] - style_distance[at_y, at_x]), numbers[3])
        cost += numbers[4] * (apart * apart)
    if cost >= limit:
        return cost
    turn = turn_between(style_bins, at_x, at_y, direction)
    side = taps.shape[1]
    radius = side // 2
    lanes[:] = 0
    for out in range(radius + 1):
        for sign in range(1 if out == 0 else 2):
            row = radius + (out if sign else -out)
            for tap in range(side):
                sx = at_x + pad + taps[turn, row, tap, 0]
                sy = at_y + pad + taps[turn, row, tap, 1]
                for c in range(channels):
                    j = tap * channels + c
                    there = int(style[sy, sx, c])
                    e = (int(target[y + row, x + tap, c]) - there) * int(weights[row, j])
                    lanes[(j & 15) >> 1] += e * e
                    if wanted.size:
                        e = (int(wanted[row, j]) - there) * int(wanted_weights[row, j])
                        lanes[(j & 15) >> 1] += e * e
        total = 0
        for k in range(8):
            total += lanes[k] >> SCALE_SHIFT
        if out and cost + np.float32(total) >= limit:
            return cost + np.float32(total)
    cost += np.float32(total)
    if coherence > 0 and cost < limit:
        sum_ = 0
        for row in range(side):
            for tap in range(side):
                ox = int(field[y + row, x + tap, 0]) - at_x - taps[turn, row, tap, 0]
                oy = int(field[y + row, x + tap, 1]) - at_y - taps[turn, row, tap, 1]
                ox, oy = min(max(ox, -255), 255), min(max(oy, -255), 255)
                sum_ += min(ox * ox + oy * oy, reach) * step_weights[row, tap]
        cost += coherence * np.float32(sum_)
    return cost


@kernel
def _expect(
    was: Array, x: int, y: int, direction: int, target: Array, past: Array, visible: Array, style: Array,
    style_bins: Array, keyed: Array, taps: Array, channels: int, pad: int, wanted: Array, wanted_weights: Array,
) -> None:  # fmt: skip
    wanted[:] = 0
    wanted_weights[:] = 0
    side = taps.shape[1]
    height, width = style.shape[0] - 2 * pad, style.shape[1] - 2 * pad
    at_x = min(max(int(np.rint(was[y, x, 0])), 0), width - 1)
    at_y = min(max(int(np.rint(was[y, x, 1])), 0), height - 1)
    turn = turn_between(style_bins, at_x, at_y, direction)
    for row in range(side):
        for tap in range(side):
            if was[y, x, 0] <= _NOWHERE or not visible[y + row, x + tap]:
                continue
            sx, sy = at_x + pad + taps[turn, row, tap, 0], at_y + pad + taps[turn, row, tap, 1]
            for c in range(channels):
                now, then = int(target[y + row, x + tap, c]), int(past[y + row, x + tap, c])
                wanted[row, tap * channels + c] = int(style[sy, sx, c]) + now - then
                wanted_weights[row, tap * channels + c] = keyed[row, tap * channels + c]


@kernel
def improve(
    offsets: Array, improved: Array, target: Array, field: Array, bins: Array, style: Array, style_bins: Array,
    usable: Array, style_distance: Array, weights: Array, taps: Array, cosines: Array, step_weights: Array,
    before: Array, penalty: Array, distance: Array, was: Array, past: Array, visible: Array, keyed: Array,
    ribbons: Array, given: Array, numbers: Array, channels: int, pad: int, jump: int, search_px: np.float32,
    ribbon_px: np.float32, seed: int, stream: int, round_: int,
) -> None:  # fmt: skip
    """One iteration over every pixel. `numbers`: r_max, coherence, steadiness, d_max, line weight, float32."""
    height, width, _ = offsets.shape
    style_height, style_width = style.shape[0] - 2 * pad, style.shape[1] - 2 * pad
    lanes = np.zeros(8, np.int64)
    shape = weights.shape if past.size else (0, 0)
    wanted, wanted_weights = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    candidates = np.empty((16, 2), np.float32)
    for y in range(height):
        for x in range(width):
            if given.size and given[y, x, 0] > _NOWHERE:
                improved[y, x] = given[y, x]
                continue
            direction = bins[y, x] if bins.size else NO_DIRECTION
            if past.size:
                _expect(was, x, y, direction, target, past, visible, style, style_bins, keyed, taps, channels, pad,
                        wanted, wanted_weights)  # fmt: skip
            best_x, best_y = offsets[y, x, 0], offsets[y, x, 1]
            at_x = min(max(int(np.rint(best_x)), 0), style_width - 1)
            at_y = min(max(int(np.rint(best_y)), 0), style_height - 1)
            no_x, no_y = -1, -1
            best = _goal(at_x, at_y, _INFINITE, x, y, direction, target, field, style, style_bins, style_distance,
                         weights, taps, step_weights, before, penalty, distance, wanted, wanted_weights, numbers,
                         channels, pad, lanes)  # fmt: skip
            count = 0
            if before.size and was[y, x, 0] > _NOWHERE:
                candidates[0] = was[y, x]
                count = 1
            for k in range(8 if jump > 1 else 4):
                far = 1 if k < 4 else jump
                dx = -far if k & 3 == 0 else far if k & 3 == 1 else 0
                dy = -far if k & 3 == 2 else far if k & 3 == 3 else 0
                if not (0 <= x + dx < width and 0 <= y + dy < height):
                    continue
                other = bins[y + dy, x + dx] if bins.size else NO_DIRECTION
                found = carried(offsets[y + dy, x + dx, 0], offsets[y + dy, x + dx, 1], np.float32(-dx),
                                np.float32(-dy), other, style_bins, cosines, style_width, style_height)  # fmt: skip
                candidates[count, 0], candidates[count, 1] = found
                count += 1
            for k in range(2 if ribbons.size else 0):
                if ribbons[k, y, x, 0] <= _NOWHERE:
                    continue
                words = philox(x, y, round_, _RIBBON + k, seed, stream)
                rx = np.rint((unit(words[0]) * _TWO - _ONE) * ribbon_px)
                ry = np.rint((unit(words[1]) * _TWO - _ONE) * ribbon_px)
                candidates[count] = ribbons[k, y, x]
                candidates[count + 1, 0] = ribbons[k, y, x, 0] + np.float32(rx)
                candidates[count + 1, 1] = ribbons[k, y, x, 1] + np.float32(ry)
                count += 2
            far_px, step, index = search_px, 0, 0
            words = philox(x, y, round_, 0, seed, stream)
            while index < count or far_px >= _ONE:
                if index < count:
                    cx, cy = candidates[index, 0], candidates[index, 1]
                    index += 1
                else:
                    second = step & 1
                    if not second:
                        words = philox(x, y, round_, step >> 1, seed, stream)
                    a, b = (words[2], words[3]) if second else (words[0], words[1])
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
                if usable.size and not usable[ty, tx]:
                    continue
                cost = _goal(tx, ty, best, x, y, direction, target, field, style, style_bins, style_distance, weights,
                             taps, step_weights, before, penalty, distance, wanted, wanted_weights, numbers, channels,
                             pad, lanes)  # fmt: skip
                if cost < best:
                    best, at_x, at_y, best_x, best_y = cost, tx, ty, cx, cy
                else:
                    no_x, no_y = tx, ty
            improved[y, x, 0], improved[y, x, 1] = best_x, best_y
