"""Weighted Laplace equation on the pixel grid with given pixels and absorbing terms: set up once, solve often.

    sum over the four neighbours j of w_ij (x_i - x_j)  +  a_i x_i  =  b_i        where x_i is not given

The picture's border is a Neumann boundary: no edges lead outside. Conjugate gradients preconditioned by a V-cycle need
less than one V-cycle per decimal digit, for any size and any shape of the given regions. They need more where weights
differ by a factor of 1000 along ragged borders and few pixels are given or absorb.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.frames import Mask
from pipeline.kernels.jit import kernel
from pipeline.solvers.grid import (
    RIGHT_SIDE,
    SOLUTION,
    Doubles,
    Levels,
    advance,
    build_levels,
    conjugate,
    dot,
    finest,
    multiply,
    v_cycle,
    work_arrays,
)
from pipeline.solvers.undetermined import undetermined

TOLERANCE = 1e-6
"""Residual norm relative to that of x = 0 at which the iteration stops; its effect is below float32 resolution."""

MAX_CYCLES = 40
"""Largest number of V-cycles. With uniform weights, twelve suffice for any layout of regions."""


@dataclass(frozen=True)
class Solution:
    """Solution and convergence history.

    Attributes:
        x: float32 (h, w) or (labels, h, w), the shape of the given values.
        residuals: for each label, the residual norm before the first V-cycle and after each, relative to that of x = 0.
    """

    x: NDArray[np.float32]
    residuals: tuple[tuple[float, ...], ...]

    @property
    def cycles(self) -> int:
        """Largest number of V-cycles over the labels."""
        return max((len(history) - 1 for history in self.residuals), default=0)

    @property
    def residual(self) -> float:
        """Largest final relative residual over the labels."""
        return max((history[-1] for history in self.residuals), default=0.0)


FAINTEST = 1e-9
"""Weights up to this fraction of the largest edge weight are treated as 0."""


class Multigrid:
    """The matrix, ready to solve for any right-hand side; safe to share between threads.

    Attributes:
        adrift: bool (h, w), pixels that are not connected to any given value or absorbing term. Their equations have no
            unique solution, so they get a fallback value.
    """

    def __init__(
        self, fixed: Mask, *, right: AnyArray | None = None, down: AnyArray | None = None,
        absorb: AnyArray | None = None,
    ) -> None:  # fmt: skip
        """Build all coarse grids, in time and memory linear in the number of pixels.

        Edges up to `FAINTEST` of the largest weight are removed; absorbing terms as small do not determine a pixel.

        Args:
            fixed: bool (h, w), h and w >= 1: pixels whose value is given with each right-hand side.
            right: (h, w - 1), weights >= 0 of the edges between horizontal neighbours; None = 1 everywhere.
            down: (h - 1, w), between vertical ones.
            absorb: (h, w), the terms a >= 0; None = 0 everywhere.

        Raises:
            BadParameter: a wrong shape, or a weight that is negative, infinite or NaN.

        Source: coarse grids of dendy1982black; V-cycles as a preconditioner, trottenberg2001multigrid, section 7.8.
        """
        height, width = _mask(fixed).shape
        self.fixed = fixed.astype(bool)
        edges = _weights(right, (height, width - 1), "right", 1.0), _weights(down, (height - 1, width), "down", 1.0)
        least = FAINTEST * max(weights.max(initial=0.0) for weights in edges)
        self._right, self._down = (np.where(weights > least, weights, 0.0) for weights in edges)
        self._absorb = _weights(absorb, (height, width), "absorb", 0.0)
        self.undetermined = undetermined(self.fixed | (self._absorb > least), self._right, self._down)
        stencil = _stencil(self.fixed | self.undetermined, self._right, self._down, self._absorb)
        self._levels = build_levels(stencil)

    def solve(
        self, values: AnyArray, *, source: AnyArray | None = None, start: AnyArray | None = None,
        fallback: float = 0.0, tolerance: float = TOLERANCE, max_cycles: int = MAX_CYCLES,
    ) -> Solution:  # fmt: skip
        """Solve for one or several right-hand sides. Each is solved independently, with the same bytes as alone.

        If only absorbing pixels have sources, the solution is clipped to the range of the given values and of b / a
        (maximum principle).

        Args:
            values: (h, w) or (labels, h, w), the given values; only pixels in `fixed` are read, and must be finite.
            source: the terms b, of the shape of `values` or (h, w); None = 0.
            start: initial guess, of the shape of `values` or (h, w), such as the previous frame's solution; None = 0.
            fallback: value of the pixels in `undetermined`.
            tolerance: target residual norm relative to that of x = 0, in (0, 1).
            max_cycles: largest number of V-cycles, >= 1. `Solution.residual` tells whether the tolerance was reached.

        Raises:
            BadParameter: an array has a wrong shape or is not finite where it is read; a number is out of its range.
        """
        _check_effort(tolerance, max_cycles)
        given = self._batch(values, "values")
        labels = len(given)
        shape = np.shape(values)
        sources = np.zeros(given.shape) if source is None else self._batch(source, "source", labels)
        starts = np.zeros(given.shape) if start is None else self._batch(start, "start", labels)
        solved = [
            self._one(*arrays, fallback, tolerance, max_cycles) for arrays in zip(given, sources, starts, strict=True)
        ]
        x = np.array([found for found, _ in solved], np.float32).reshape(shape)
        return Solution(x, tuple(history for _, history in solved))

    def _batch(self, array: AnyArray, field: str, labels: int | None = None) -> Doubles:
        given = np.asarray(array, np.float64)
        if given.shape[-2:] != self.fixed.shape or given.ndim not in (2, 3):
            raise BadParameter(
                "The array must have one value per pixel, for one or several labels.", field=field, value=given.shape,
                remedy=f"Use the shape {self.fixed.shape} or (labels, {self.fixed.shape[0]}, {self.fixed.shape[1]}).",
            )  # fmt: skip
        given = given.reshape(-1, *self.fixed.shape)
        read = self.fixed if field == "values" else True
        if not np.isfinite(given).all(where=read):
            raise BadParameter("The array must be finite where it is read.", field=field, value="NaN or infinity")
        if labels is None or len(given) == labels:
            return given
        if len(given) != 1:
            raise BadParameter(
                "The array must have one plane, or one for each label.",
                field=field,
                value=len(given),
                remedy=f"Give {labels}.",
            )
        return np.broadcast_to(given, (labels, *self.fixed.shape))

    def _one(
        self, values: Doubles, source: Doubles, start: Doubles, fallback: float, tolerance: float, max_cycles: int
    ) -> tuple[Doubles, tuple[float, ...]]:
        padded = values.shape[0] + 2, values.shape[1] + 2
        pull, first = np.zeros(padded), np.zeros(padded)
        _prepare((self.fixed, self.undetermined), values, source, start, self._right, self._down, pull, first)
        x, history = _iterate(self._levels, pull, first, tolerance, max_cycles)
        found = np.empty(values.shape)
        _finish((self.fixed, self.undetermined), values, source, self._absorb, fallback, x, found)
        return found, history


@kernel
def _prepare(
    kinds: tuple[Mask, Mask], values: Doubles, source: Doubles, start: Doubles, right: Doubles, down: Doubles,
    pull: Doubles, first: Doubles,
) -> None:  # fmt: skip
    """Fill the padded right-hand side and first guess of the pixels that are neither given nor adrift."""
    fixed, loose = kinds
    height, width = fixed.shape
    for y in range(height):
        for x in range(width):
            if fixed[y, x] or loose[y, x]:
                continue
            given = 0.0
            if x + 1 < width and fixed[y, x + 1]:
                given += right[y, x] * values[y, x + 1]
            if x > 0 and fixed[y, x - 1]:
                given += right[y, x - 1] * values[y, x - 1]
            if y + 1 < height and fixed[y + 1, x]:
                given += down[y, x] * values[y + 1, x]
            if y > 0 and fixed[y - 1, x]:
                given += down[y - 1, x] * values[y - 1, x]
            pull[y + 1, x + 1] = source[y, x] + given
            first[y + 1, x + 1] = start[y, x]


@kernel
def _finish(
    kinds: tuple[Mask, Mask], values: Doubles, source: Doubles, absorb: Doubles, fallback: float, x: Doubles,
    out: Doubles,
) -> None:  # fmt: skip
    """The solution at all pixels, clipped to the range of the given values and of b / a (maximum principle) if only
    absorbing pixels have sources; `x` is padded."""
    fixed, loose = kinds
    height, width = fixed.shape
    low, high, bounded = math.inf, -math.inf, True
    for i in range(height):
        for j in range(width):
            if loose[i, j]:
                out[i, j] = fallback
            elif fixed[i, j]:
                out[i, j] = values[i, j]
                low, high = min(low, values[i, j]), max(high, values[i, j])
            else:
                out[i, j] = x[i + 1, j + 1]
                if absorb[i, j] > 0:
                    bound = source[i, j] / absorb[i, j]
                    low, high = min(low, bound), max(high, bound)
                elif source[i, j] != 0:
                    bounded = False
    if not bounded or low > high:
        return
    for i in range(height):
        for j in range(width):
            if not loose[i, j]:
                out[i, j] = min(max(out[i, j], low), high)


def _iterate(
    levels: Levels, right: Doubles, x: Doubles, tolerance: float, max_cycles: int
) -> tuple[Doubles, tuple[float, ...]]:
    """Conjugate gradients starting from `x`, in place; residual norms are relative to that of `right`."""
    stencil, work = levels.stencil, work_arrays(levels)
    whole = math.sqrt(dot(right, right))
    if whole == 0.0:
        return np.zeros_like(right), (0.0,)
    image, direction, old = np.zeros_like(right), np.zeros_like(right), math.inf
    multiply(stencil, x, image)
    residual, better = finest(levels, work, RIGHT_SIDE), finest(levels, work, SOLUTION)
    np.subtract(right, image, out=residual)
    history = [math.sqrt(dot(residual, residual)) / whole]
    while history[-1] > tolerance and len(history) <= max_cycles:
        v_cycle(levels, work)
        new = dot(residual, better)
        conjugate(direction, better, new / old)
        energy = multiply(stencil, direction, image)
        if not (new > 0 and energy > 0):  # only rounding errors are left
            break
        history.append(math.sqrt(advance(x, residual, direction, image, new / energy)) / whole)
        old = new
    return x, tuple(history)


def _stencil(settled: Mask, right: Doubles, down: Doubles, absorb: Doubles) -> Doubles:
    """Matrix of the free pixels (neither given nor adrift); edges to given pixels only add to the diagonal."""
    out = np.zeros((5, settled.shape[0] + 2, settled.shape[1] + 2))
    _fill_stencil(settled, right, down, absorb, out)
    return out


@kernel
def _fill_stencil(settled: Mask, right: Doubles, down: Doubles, absorb: Doubles, out: Doubles) -> None:
    height, width = settled.shape
    for y in range(height):
        for x in range(width):
            if settled[y, x]:
                continue
            total = absorb[y, x]
            if x + 1 < width:
                total += right[y, x]
                out[1, y + 1, x + 1] = 0.0 if settled[y, x + 1] else right[y, x]
            if x > 0:
                total += right[y, x - 1]
            if y + 1 < height:
                total += down[y, x]
                out[2, y + 1, x + 1] = 0.0 if settled[y + 1, x] else down[y, x]
            if y > 0:
                total += down[y - 1, x]
            out[0, y + 1, x + 1] = total


def _mask(fixed: Mask) -> Mask:
    if fixed.ndim != 2 or fixed.size == 0 or fixed.dtype != np.bool_:
        raise BadParameter(
            "The mask must state for each pixel whether its value is given.", field="fixed",
            value=f"{fixed.dtype} {fixed.shape}", remedy="Use a bool array (height, width).",
        )  # fmt: skip
    return fixed


def _check_effort(tolerance: float, max_cycles: int) -> None:
    if not 0 < tolerance < 1:
        raise BadParameter(
            "The tolerance must be between 0 and 1.", field="tolerance", value=tolerance, remedy="Use 1e-6."
        )
    if max_cycles < 1:
        raise BadParameter("At least one V-cycle is needed.", field="max_cycles", value=max_cycles, remedy="Use 40.")


def _weights(given: AnyArray | None, shape: tuple[int, int], field: str, default: float) -> Doubles:
    if given is None:
        return np.full(shape, default)
    weights = np.asarray(given, np.float64)
    if weights.shape != shape:
        raise BadParameter("The array must have one weight per edge, or per pixel.", field=field, value=weights.shape,
                           remedy=f"Use the shape {shape}.")  # fmt: skip
    if not (np.isfinite(weights).all() and (weights >= 0).all()):
        raise BadParameter("Weights must be finite and not negative.", field=field, value=weights.min(),
                           remedy="Use 0 to separate two pixels.")  # fmt: skip
    return weights
