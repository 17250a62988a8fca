"""Weak classifiers of a cascade in kernels, for eight windows of a row at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.intrinsics import LANES, Arguments, Intrinsic, Vectors

RECTS = 3
"""Most rectangles of a feature."""
CORNERS = 4
"""Corners of a rectangle."""

Stumps = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]


class AddVotes(Intrinsic):
    """`add_votes(votes, factors, window, sums, at, corners, stumps, stump)`: add a weak classifier's votes.

    The feature of a window is the sum over rectangles of weight (a - b - c + d), with the integral image at the
    rectangle's corners, times the window's factor. Below the threshold it adds the classifier's first vote, otherwise
    its second one.

    Args:
        votes: float64 (8,), the sums of votes, which are updated.
        factors: float32, by window.
        window: index of the first of eight windows there.
        sums: int32, the integral image.
        at: index of the first window's corner there; those of the others follow.
        corners: int32 (stumps * 12,): by stump, by rectangle, from a window's corner to those of the rectangle: upper
            left, upper right, lower left, lower right.
        stumps: float32 weights (stumps * 3,), the third 0 if there are two rectangles; thresholds (stumps,); votes
            (stumps * 2,).
        stump: which weak classifier.
    """

    def __call__(
        self,
        votes: NDArray[np.float64],
        factors: NDArray[np.float32],
        window: int,
        sums: NDArray[np.int32],
        at: int,
        corners: NDArray[np.int32],
        stumps: Stumps,
        stump: int,
    ) -> None:
        weights, thresholds, leaves = stumps
        for lane in range(LANES):
            feature = np.float32(0)
            for rect in range(RECTS):
                a, b, c, d = (sums[at + lane + k] for k in corners[(stump * RECTS + rect) * CORNERS :][:CORNERS])
                feature += weights[stump * RECTS + rect] * np.float32(a - b - c + d)
            votes[lane] += leaves[stump * 2 + (feature * factors[window + lane] >= thresholds[stump])]

    def generator(self) -> Any:
        from numba.core import types as numba_types

        types: Any = numba_types

        def add_votes(
            _typing: Any, votes: Any, factors: Any, window: Any, sums: Any, at: Any, corners: Any, stumps: Any,
            stump: Any,
        ) -> Any:  # fmt: skip
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                self._instructions(Vectors(builder), Arguments(context, builder, signature, args))
                return context.get_dummy_value()

            return types.none(votes, factors, window, sums, at, corners, stumps, stump), generate

        return add_votes

    def _instructions(self, on: Vectors, given: Arguments) -> None:
        build, ir = on.build, on.ir
        votes, factors, sums, corners = (given.data(place) for place in (0, 1, 3, 5))
        window, at, stump = (given.number(place) for place in (2, 4, 7))
        weights, thresholds, leaves = given.datas(6)
        doubles = ir.VectorType(ir.DoubleType(), LANES)

        def product(rect: int, weight: Any) -> Any:
            first = on.plus(build.mul(stump, ir.Constant(stump.type, RECTS * CORNERS)), rect * CORNERS)
            ends = [build.load(build.gep(corners, [on.plus(first, k)])) for k in range(CORNERS)]
            a, b, c, d = (on.loaded(sums, build.add(at, build.sext(end, at.type))) for end in ends)
            area = build.add(build.sub(build.sub(a, b), c), d)
            return build.fmul(on.all(weight), build.sitofp(area, on.floats))

        def one(array: Any, each: int, place: int) -> Any:
            index = on.plus(build.mul(stump, ir.Constant(stump.type, each)), place)
            return build.load(build.gep(array, [index]))

        feature = build.fadd(product(0, one(weights, RECTS, 0)), product(1, one(weights, RECTS, 1)))
        last = one(weights, RECTS, 2)
        has_third = build.fcmp_unordered("!=", last, ir.Constant(ir.FloatType(), 0.0))
        feature = on.where(has_third, lambda: build.fadd(feature, product(2, last)), feature)
        feature = build.fmul(feature, on.loaded(factors, window))
        below = build.fcmp_ordered("<", feature, on.all(one(thresholds, 1, 0)))
        vote = build.select(below, on.all(one(leaves, 2, 0)), on.all(one(leaves, 2, 1)))
        zero = ir.Constant(ir.IntType(64), 0)
        total = build.fadd(on.loaded(votes, zero), build.fpext(vote, doubles))
        on.store(total, votes, zero)


add_votes = AddVotes()
