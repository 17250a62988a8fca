"""Reference implementation of synthesis in NumPy and Numba: the specification of `fields.cl` and `patchmatch.cl`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Plane
from pipeline.kernels.jit import kernel
from pipeline.strokes.random import philox
from pipeline.synthesis.antialias import antialiased
from pipeline.synthesis.energy import NO_DIRECTION, cosines, tables, taps
from pipeline.synthesis.energy import Energy as Energy
from pipeline.synthesis.images import NOWHERE, Offsets, StyleImage, Target
from pipeline.synthesis.images import packed as pack
from pipeline.synthesis.operations import FrameState, LoadedStyle, RandomKey, Search, iteration, key_words
from pipeline.synthesis.reference_energy import Inputs, Iteration, StyleDirections, extrapolated_offset, improve, unit

Array = AnyArray
Size = tuple[int, int]
_NONE = np.zeros(0, np.uint8)
_BINOMIAL = (20, 15, 6, 1)
_NOWHERE = NOWHERE
_WHOLE = ("coherence_limit", "jump", "seed", "stream", "round")
_RANDOM_POSITION, _MERGE = 0x5CA77E12, 0x3E26E000


def _spread(image: Array, margin: int) -> Array:
    return np.pad(image, ((margin, margin), (margin, margin)) + ((0, 0),) * (image.ndim - 2), "edge")


class PatchShape(NamedTuple):
    """Radius of a patch and margin of the style image, px, and number of colour channels."""

    radius: int
    pad: int
    colours: int


class ReferenceOperations:
    """Implementation of `operations.Operations` in host memory."""

    def upload(self, array: Array) -> Array:
        return array

    def fetch(self, array: Array) -> Array:
        return array

    def finish(self) -> None:
        """Return immediately: all operations are synchronous."""

    def load(self, style: StyleImage, energy: Energy) -> LoadedStyle[Array]:
        def or_empty(array: Array | None, like: type[np.generic] = np.uint8) -> Array:
            return np.zeros((0, 0), like) if array is None else array

        features = _spread(style.features, energy.pad)
        distance = or_empty(style.distance, np.float32)
        return LoadedStyle(
            style, energy, features, or_empty(style.bins), or_empty(style.usable), distance, taps(energy.radius), _NONE
        )

    def prepare(self, style: LoadedStyle[Array], target: Target) -> FrameState[Array]:
        energy, (width, height) = style.energy, target.size
        blank = pack(energy, np.zeros((height, width, energy.colours), np.uint8), target.guides)
        field = np.zeros((height + 2 * energy.radius, width + 2 * energy.radius, 2), np.int16)
        return FrameState(target.size, _spread(blank, energy.radius), field, target.bins, target.distance)

    def random_offsets(self, style: LoadedStyle[Array], size: Size, key: RandomKey) -> Array:
        out = np.full((size[1], size[0], 2), NOWHERE, np.float32)
        none = np.zeros(out.shape[:2], np.float32)
        _merge(out, out, out, none, style.usable, key_words(key), style.style.first_usable, style.size)
        return out

    def render(self, style: LoadedStyle[Array], state: FrameState[Array], offsets: Array, votes: bool = False) -> None:
        energy, bins = style.energy, _or(state.bins, np.zeros((0, 0), np.uint8))
        shape = PatchShape(energy.radius, energy.pad, energy.colours)
        width, height = style.features.shape[1] - 2 * energy.pad, style.features.shape[0] - 2 * energy.pad
        directions = StyleDirections(style.bins, cosines(), width, height)
        _render(offsets, bins, style.features, directions, state.packed, state.field, shape)
        if votes:
            _vote(offsets, bins, style.features, directions, state.packed, shape)

    def add_change(
        self, style: LoadedStyle[Array], state: FrameState[Array], advected: Array, guides: Array, visible: Array
    ) -> None:
        energy, (width, height) = style.energy, style.size
        used = slice(energy.colours, energy.colours + len(energy.guides))
        x = np.clip(np.rint(advected[..., 0]), 0, width - 1).astype(np.int64) + energy.pad
        y = np.clip(np.rint(advected[..., 1]), 0, height - 1).astype(np.int64) + energy.pad
        change = style.features[y, x, used].astype(np.int32) - guides
        share = tables(energy).change_fraction[used].astype(np.int32)
        known = (visible > 0) & (advected[..., 0] > NOWHERE)
        shift = np.where(known[..., None], (change * share + 64) >> 7, 0)
        expected = state.packed[..., used] + _spread(shift, energy.radius)
        state.packed[..., used] = np.clip(expected, 0, 255).astype(np.uint8)

    def penalty(self, style: LoadedStyle[Array], size: Size, offsets: Array) -> Array:
        energy, (width, height) = style.energy, style.size
        at = np.rint(offsets).astype(np.int64)
        index = np.clip(at[..., 1], 0, height - 1) * width + np.clip(at[..., 0], 0, width - 1)
        counts = np.bincount(index.ravel(), minlength=width * height).reshape(height, width).astype(np.float32)
        sum_ = _binomial(_binomial(counts, 1), 0)
        area = width * height if style.style.usable is None else max(1, int(np.count_nonzero(style.style.usable)))
        mean_uses = max(1.0, size[0] * size[1] / area)
        threshold = np.float32(energy.h_limit * mean_uses)
        slope = np.float32(energy.w_h / mean_uses * tables(energy).centre)
        return np.asarray(slope * np.maximum(np.float32(0), sum_ * np.float32(2.44140625e-4) - threshold), np.float32)

    def improve(
        self, style: LoadedStyle[Array], state: FrameState[Array], offsets: Array, penalty: Array | None, search: Search
    ) -> Array:
        made, out = tables(style.energy), np.empty_like(offsets)
        lines = None if style.style.distance is None else state.distance
        flat, deep = np.zeros((0, 0), np.float32), np.zeros((0, 0, 0), np.float32)
        bytes2, bytes3 = np.zeros((0, 0), np.uint8), np.zeros((0, 0, 0), np.uint8)
        inputs = Inputs(
            offsets, state.packed, state.field, _or(state.bins, bytes2), style.features, style.bins, style.usable,
            style.distance, made.weights, style.tap_indices, cosines(), made.tap_weights,
            _or(state.advected_colours, bytes3), _or(penalty, flat), _or(lines, flat),
            _or(state.advected, deep),
            _or(state.ribbons, np.zeros((0, 0, 0, 0), np.float32)), _or(state.fixed, deep),
            _or(state.before, deep),
        )  # fmt: skip
        improve(inputs, self._iteration(style, state.size, search), out)
        return out

    @staticmethod
    def _iteration(style: LoadedStyle[Array], size: Size, search: Search) -> Iteration:
        numbers = iteration(style, size, search)
        given = (int(numbers[name]) if name in _WHOLE else numbers[name] for name in Iteration._fields[:-2])
        return Iteration._make([*given, style.energy.channels, style.energy.pad])

    def advect(
        self, style: LoadedStyle[Array], state: FrameState[Array], offsets: Array, bins: Array | None, displacement:
        Array,
        visible: Array,
    ) -> Array:  # fmt: skip
        out = np.empty((state.size[1], state.size[0], 2), np.float32)
        other_bins = _or(bins, np.zeros((0, 0), np.uint8))
        style_bins = style.bins if style.style.bins is not None else np.zeros((0, 0), np.uint8)
        usable = style.usable if style.style.usable is not None else np.zeros((0, 0), np.uint8)
        _advect(
            offsets, other_bins, displacement, visible, StyleDirections(style_bins, cosines(), *style.size), usable, out
        )
        return out

    def upsample(
        self,
        coarse: LoadedStyle[Array],
        state: FrameState[Array],
        offsets: Array,
        style: LoadedStyle[Array],
        to: FrameState[Array],
    ) -> Array:
        out = np.empty((to.size[1], to.size[0], 2), np.float32)
        coarse_bins = _or(state.bins, np.zeros((0, 0), np.uint8))
        _upsample(
            offsets, coarse_bins, StyleDirections(coarse.bins, cosines(), *coarse.size), style.usable, out, style.size
        )
        return out

    def merge(
        self,
        style: LoadedStyle[Array],
        size: Size,
        first: Array,
        second: Array,
        probability: float | Plane,
        key: RandomKey,
    ) -> Array:
        out = np.empty((size[1], size[0], 2), np.float32)
        of_each = np.full(out.shape[:2], probability, np.float32)
        _merge(first, second, out, of_each, style.usable, key_words(key), style.style.first_usable, style.size)
        return out

    def colours_at(self, style: LoadedStyle[Array], size: Size, offsets: Array) -> Array:
        pad = style.energy.pad
        x, y = (np.clip(np.rint(offsets[..., k]).astype(np.int64), 0, style.size[k] - 1) for k in (0, 1))
        known = np.where(offsets[..., 0] > NOWHERE, np.uint8(255), np.uint8(0))
        return np.dstack([style.features[y + pad, x + pad, :3], known])

    def apply_fixed(self, style: LoadedStyle[Array], size: Size, fixed: Array, offsets: Array) -> Array:
        np.copyto(offsets, fixed, where=fixed[..., :1] > NOWHERE)
        return offsets

    def antialiased(
        self, style: LoadedStyle[Array], state: FrameState[Array], offsets: Array, paintable: Array | None
    ) -> Array:
        return antialiased(style.style, offsets, state.bins, paintable)


def _or(array: Array | None, absent: Array) -> Array:
    return absent if array is None else array


def _binomial(image: Array, axis: int) -> Array:
    """Filter with the kernel 1 6 15 20 15 6 1 along an axis, with repeated border; exact in float32."""
    wide = np.pad(image, [(3, 3) if axis == k else (0, 0) for k in (0, 1)], "edge")
    size = image.shape[axis]

    def at(shift: int) -> Array:
        return wide.take(np.arange(3 + shift, 3 + shift + size), axis)

    sums = [np.float32(w) * (at(-k) + at(k) if k else at(0)) for k, w in enumerate(_BINOMIAL)]
    return np.asarray(((sums[0] + sums[1]) + sums[2]) + sums[3], np.float32)


@kernel
def _usable(x: int, y: int, usable: Array, width: int, height: int) -> bool:
    inside = 0 <= x < width and 0 <= y < height
    return inside and (usable.size == 0 or usable[y, x] != 0)


@kernel
def _merge(
    first: Offsets, second: Offsets, out: Offsets, probability: Plane, usable: Array, key: tuple[int, int],
    start: tuple[int, int], size: tuple[int, int],
) -> None:  # fmt: skip
    (seed, stream), (width, height) = key, size
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            draw = unit(philox(x, y, 0, _MERGE, seed, stream)[0])
            a, b = first[y, x], second[y, x]
            taken = a if b[0] <= _NOWHERE or (a[0] > _NOWHERE and draw < probability[y, x]) else b
            found_x, found_y = taken[0], taken[1]
            if found_x <= _NOWHERE:
                found_x, found_y = np.float32(start[0]), np.float32(start[1])
                for k in range(8):
                    key_words = philox(x, y, k, _RANDOM_POSITION, seed, stream)
                    tx = min(int(unit(key_words[0]) * np.float32(width)), width - 1)
                    ty = min(int(unit(key_words[1]) * np.float32(height)), height - 1)
                    if _usable(tx, ty, usable, width, height):
                        found_x, found_y = np.float32(tx), np.float32(ty)
                        break
            out[y, x, 0], out[y, x, 1] = found_x, found_y


@kernel
def _render(
    offsets: Offsets, bins: Array, style: Array, directions: StyleDirections, target: Array, field: Array,
    shape: PatchShape,
) -> None:  # fmt: skip
    height, width = offsets.shape[:2]
    radius, pad, colours = shape
    for y in range(height + 2 * radius):
        for x in range(width + 2 * radius):
            hx, hy = x - radius, y - radius
            ix, iy = min(max(hx, 0), width - 1), min(max(hy, 0), height - 1)
            ox, oy = offsets[iy, ix, 0], offsets[iy, ix, 1]
            if hx != ix or hy != iy:
                direction = bins[iy, ix] if bins.size else NO_DIRECTION
                ox, oy = extrapolated_offset(ox, oy, np.float32(hx - ix), np.float32(hy - iy), direction, directions)
            ax, ay = int(np.rint(ox)), int(np.rint(oy))
            sx, sy = min(max(ax, 0), directions.width - 1), min(max(ay, 0), directions.height - 1)
            for c in range(colours):
                target[y, x, c] = style[sy + pad, sx + pad, c]
            field[y, x, 0], field[y, x, 1] = ax, ay


@kernel
def _vote(
    offsets: Offsets, bins: Array, style: Array, directions: StyleDirections, target: Array, shape: PatchShape
) -> None:
    height, width = offsets.shape[:2]
    radius, pad, colours = shape
    count = (radius + 1) ** 2
    for y in range(height + 2 * radius):
        for x in range(width + 2 * radius):
            hx, hy = x - radius, y - radius
            total = np.zeros(colours, np.int64)
            for dy in range(-radius, radius + 1, 2):
                for dx in range(-radius, radius + 1, 2):
                    px, py = min(max(hx + dx, 0), width - 1), min(max(hy + dy, 0), height - 1)
                    direction = bins[py, px] if bins.size else NO_DIRECTION
                    ox, oy = extrapolated_offset(
                        offsets[py, px, 0], offsets[py, px, 1], np.float32(hx - px), np.float32(hy - py), direction,
                        directions,
                    )  # fmt: skip
                    sx = min(max(int(np.rint(ox)), 0), directions.width - 1)
                    sy = min(max(int(np.rint(oy)), 0), directions.height - 1)
                    for c in range(colours):
                        total[c] += style[sy + pad, sx + pad, c]
            for c in range(colours):
                target[y, x, c] = (total[c] + count // 2) // count


@kernel
def _advect(
    offsets: Offsets, bins: Array, displacement: Array, visible: Array, style: StyleDirections, usable: Array,
    out: Offsets,
) -> None:  # fmt: skip
    height, width = out.shape[:2]
    for y in range(height):
        for x in range(width):
            fx, fy = np.float32(x) + displacement[y, x, 0], np.float32(y) + displacement[y, x, 1]
            nx, ny = int(np.rint(fx)), int(np.rint(fy))
            found_x, found_y = _NOWHERE, _NOWHERE
            if visible[y, x] and 0 <= nx < width and 0 <= ny < height:
                if offsets[ny, nx, 0] > _NOWHERE:
                    direction = bins[ny, nx] if bins.size else NO_DIRECTION
                    found_x, found_y = extrapolated_offset(
                        offsets[ny, nx, 0], offsets[ny, nx, 1], fx - np.float32(nx), fy - np.float32(ny), direction,
                        style,
                    )  # fmt: skip
                if not _usable(int(np.rint(found_x)), int(np.rint(found_y)), usable, style.width, style.height):
                    found_x, found_y = _NOWHERE, _NOWHERE
            out[y, x, 0], out[y, x, 1] = found_x, found_y


@kernel
def _upsample(
    coarse: Offsets, bins: Array, style: StyleDirections, usable: Array, out: Offsets, size: tuple[int, int]
) -> None:
    half, two = np.float32(0.5), np.float32(2)
    height, width = coarse.shape[:2]
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            nx, ny = min(x // 2, width - 1), min(y // 2, height - 1)
            ox, oy = coarse[ny, nx, 0], coarse[ny, nx, 1]
            found_x, found_y = _NOWHERE, _NOWHERE
            if ox > _NOWHERE:
                dx = (np.float32(x) + half) * half - half - np.float32(nx)
                dy = (np.float32(y) + half) * half - half - np.float32(ny)
                direction = bins[ny, nx] if bins.size else NO_DIRECTION
                cx, cy = extrapolated_offset(ox, oy, dx, dy, direction, style)
                found_x, found_y = cx * two + half, cy * two + half
                if not _usable(int(np.rint(found_x)), int(np.rint(found_y)), usable, size[0], size[1]):
                    found_x, found_y = ox * two, oy * two
                if not _usable(int(np.rint(found_x)), int(np.rint(found_y)), usable, size[0], size[1]):
                    found_x, found_y = _NOWHERE, _NOWHERE
            out[y, x, 0], out[y, x, 1] = found_x, found_y
