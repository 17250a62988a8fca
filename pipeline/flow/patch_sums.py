"""Comparison of a patch of one picture with a displaced patch of another, in kernels: the inner loop of the search for
patches, eight pixels at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.intrinsics import LANES, Arguments, Intrinsic, Vectors

PATCH_PX = LANES
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
        from numba.core import types as numba_types

        types: Any = numba_types

        def patch_sums(_typing: Any, pictures: Any, at: Any, stride: Any, place: Any, wide: Any, weights: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                given = Arguments(context, builder, signature, args)
                return context.make_tuple(builder, signature.return_type, self._instructions(Vectors(builder), given))

            return types.UniTuple(types.float32, 4)(pictures, at, stride, place, wide, weights), generate

        return patch_sums

    def _instructions(self, on: Vectors, given: Arguments) -> list[Any]:
        build = on.build
        first, dx, dy, second = given.datas(0)
        at, stride, place, wide = (given.number(place) for place in range(1, 5))
        weights = [on.all(weight) for weight in given.parts(5)]
        gradients, differences = on.zero, on.zero
        upper = on.loaded(second, place), on.loaded(second, on.plus(place, 1))
        for _ in range(PATCH_PX):
            place = build.add(place, wide)
            lower = on.loaded(second, place), on.loaded(second, on.plus(place, 1))
            parts = [build.fmul(weight, row) for weight, row in zip(weights, (*upper, *lower), strict=True)]
            d = build.fadd(build.fadd(build.fadd(parts[0], parts[1]), parts[2]), parts[3])
            d = build.fsub(d, on.loaded(first, at))
            by_x, by_y = build.fmul(d, on.loaded(dx, at)), build.fmul(d, on.loaded(dy, at))
            gradients = build.fadd(gradients, _halves_added(on, by_x, by_y))
            differences = build.fadd(differences, _halves_added(on, d, build.fmul(d, d)))
            at, upper = build.add(at, stride), lower
        return [*_totals(on, gradients), *_totals(on, differences)]


def _halves_added(on: Vectors, one: Any, other: Any) -> Any:
    """The left halves of two vectors plus their right halves."""
    left, right = (
        on.chosen(one, other, [*range(start, start + _HALF), *range(PATCH_PX + start, PATCH_PX + start + _HALF)])
        for start in (0, _HALF)
    )
    return on.build.fadd(left, right)


def _totals(on: Vectors, sums: Any) -> list[Any]:
    """The sums of both halves of a vector."""
    lanes, add = [on.element(sums, place) for place in range(PATCH_PX)], on.build.fadd
    return [add(add(a, c), add(b, d)) for a, b, c, d in (lanes[:_HALF], lanes[_HALF:])]


patch_sums = PatchSums()
