"""Comparison of a patch of one picture with a displaced patch of another, in kernels: the inner loop of the search for
patches, eight pixels at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.intrinsics import Intrinsic

PATCH_PX = 8
"""Side of a patch, px."""
_HALF = PATCH_PX // 2

Pixels = NDArray[np.float32]
"""A picture, its rows one after another: float32 (n,)."""
Four = tuple[np.float32, np.float32, np.float32, np.float32]


class PatchSums(Intrinsic):
    """`patch_sums(pictures, at, stride, place, wide, weights)`: sums over a patch of 8x8 px.

    With d = the second picture, interpolated, minus the first, and (dx, dy) = the gradient of the first:

    Args:
        pictures: the first picture, its dx and dy, and the second picture.
        at: index of the patch's first pixel in the first picture.
        stride: pixels from one of its rows to the next.
        place: index of the first pixel of the displaced patch in the second picture, rounded down.
        wide: pixels from one of its rows to the next.
        weights: of the pixel there, of the next one, of the one below, and of the one below the next.

    Returns:
        Sums of d dx, of d dy, of d, and of d^2. Each is a sum of four sums over every fourth column, in a fixed order,
        so that it is the same number on every machine.
    """

    def __call__(
        self,
        pictures: tuple[Pixels, Pixels, Pixels, Pixels],
        at: int,
        stride: int,
        place: int,
        wide: int,
        weights: Four,
    ) -> Four:
        first, dx, dy, second = pictures
        sums = np.zeros((4, _HALF), np.float32)
        for row in range(PATCH_PX):
            here, there = slice(at + row * stride, at + row * stride + PATCH_PX), place + row * wide
            corners = (there, there + 1, there + wide, there + wide + 1)
            parts = [weight * second[k : k + PATCH_PX] for weight, k in zip(weights, corners, strict=True)]
            d = parts[0] + parts[1] + parts[2] + parts[3] - first[here]
            for total, values in zip(sums, (d * dx[here], d * dy[here], d, d * d), strict=True):
                total += values[:_HALF] + values[_HALF:]
        by_x, by_y, differences, squares = ((s[0] + s[2]) + (s[1] + s[3]) for s in sums)
        return by_x, by_y, differences, squares

    def generator(self) -> Any:
        from numba.core import cgutils
        from numba.core import types as numba_types

        types: Any = numba_types
        unpacked: Any = cgutils.unpack_tuple

        def patch_sums(_typing: Any, pictures: Any, at: Any, stride: Any, place: Any, wide: Any, weights: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                pixels = [
                    context.make_array(kind)(context, builder, array).data
                    for kind, array in zip(signature.args[0], unpacked(builder, args[0]), strict=True)
                ]
                numbers = [context.cast(builder, args[k], signature.args[k], types.intp) for k in range(1, 5)]
                made = _Instructions(builder).sums(pixels, numbers, unpacked(builder, args[5]))
                return context.make_tuple(builder, signature.return_type, made)

            return types.UniTuple(types.float32, 4)(pictures, at, stride, place, wide, weights), generate

        return patch_sums


class _Instructions:
    """Generates the instructions of `PatchSums`."""

    def __init__(self, builder: Any) -> None:
        from llvmlite import ir

        self._ir, self._builder = ir, builder
        self._floats = ir.VectorType(ir.FloatType(), PATCH_PX)

    def sums(self, pixels: list[Any], numbers: list[Any], weights: list[Any]) -> list[Any]:
        build = self._builder
        first, dx, dy, second = pixels
        at, stride, place, wide = numbers
        factors = [self._all(weight) for weight in weights]
        zero = self._ir.Constant(self._floats, [0.0] * PATCH_PX)
        gradients, differences = zero, zero
        upper = self._loaded(second, place), self._loaded(second, self._plus(place, 1))
        for _ in range(PATCH_PX):
            place = build.add(place, wide)
            lower = self._loaded(second, place), self._loaded(second, self._plus(place, 1))
            parts = [build.fmul(w, row) for w, row in zip(factors, (*upper, *lower), strict=True)]
            d = build.fadd(build.fadd(build.fadd(parts[0], parts[1]), parts[2]), parts[3])
            d = build.fsub(d, self._loaded(first, at))
            by_x, by_y = build.fmul(d, self._loaded(dx, at)), build.fmul(d, self._loaded(dy, at))
            gradients = build.fadd(gradients, self._halves_added(by_x, by_y))
            differences = build.fadd(differences, self._halves_added(d, build.fmul(d, d)))
            at, upper = build.add(at, stride), lower
        return [*self._totals(gradients), *self._totals(differences)]

    def _plus(self, number: Any, step: int) -> Any:
        return self._builder.add(number, self._ir.Constant(number.type, step))

    def _all(self, value: Any) -> Any:
        """A vector of eight times the value."""
        number = self._ir.IntType(32)
        none = self._ir.Constant(self._floats, self._ir.Undefined)
        one = self._builder.insert_element(none, value, self._ir.Constant(number, 0))
        places = self._ir.Constant(self._ir.VectorType(number, PATCH_PX), [0] * PATCH_PX)
        return self._builder.shuffle_vector(one, none, places)

    def _loaded(self, array: Any, index: Any) -> Any:
        """Eight elements of an array."""
        place = self._builder.bitcast(self._builder.gep(array, [index]), self._floats.as_pointer())
        return self._builder.load(place, align=4)

    def _halves_added(self, one: Any, other: Any) -> Any:
        """The left halves of two vectors plus their right halves."""
        return self._builder.fadd(self._chosen(one, other, 0), self._chosen(one, other, _HALF))

    def _chosen(self, one: Any, other: Any, start: int) -> Any:
        places = [*range(start, start + _HALF), *range(PATCH_PX + start, PATCH_PX + start + _HALF)]
        kind = self._ir.VectorType(self._ir.IntType(32), PATCH_PX)
        return self._builder.shuffle_vector(one, other, self._ir.Constant(kind, places))

    def _totals(self, sums: Any) -> list[Any]:
        """The sums of both halves of a vector."""
        lanes = [
            self._builder.extract_element(sums, self._ir.Constant(self._ir.IntType(32), k)) for k in range(PATCH_PX)
        ]
        add = self._builder.fadd
        return [add(add(a, c), add(b, d)) for a, b, c, d in (lanes[:_HALF], lanes[_HALF:])]


patch_sums = PatchSums()
