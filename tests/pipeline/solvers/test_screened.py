"""The fast screened Poisson solver against a dense solution of the same equation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.solvers.screened import solve_screened

SHAPE = (15, 22)


def dense(absorb: NDArray[np.float32], source: NDArray[np.float32]) -> NDArray[np.float64]:
    """a x + sum over the neighbours (x_i - x_j) = b, solved by elimination."""
    height, width = absorb.shape
    number = np.arange(height * width).reshape(height, width)
    matrix = np.diag(absorb.ravel().astype(np.float64))
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    for one, other in ((a.ravel(), b.ravel()) for a, b in pairs):
        np.add.at(matrix, (one, one), 1)
        np.add.at(matrix, (other, other), 1)
        matrix[one, other] = matrix[other, one] = -1
    return np.linalg.solve(matrix, source.reshape(-1, source.shape[2])).reshape(source.shape)


def test_the_solution_is_that_of_a_dense_solver_within_gray_levels() -> None:
    draw = np.random.default_rng(3)
    absorb = (25 * draw.random(SHAPE)).astype(np.float32)
    target = (30 * draw.standard_normal((*SHAPE, 3))).astype(np.float32)
    source = absorb[..., None] * target
    difference = np.abs(solve_screened(absorb, source) - dense(absorb, source))
    assert difference.max() < 3 and difference.mean() < 0.5  # of corrections up to 100


def test_a_hole_without_weight_is_filled_from_its_surroundings() -> None:
    absorb = np.full(SHAPE, 25, np.float32)
    absorb[4:11, 6:15] = 0
    exact = np.broadcast_to(np.linspace(-20, 20, SHAPE[1], dtype=np.float32)[None, :, None], (*SHAPE, 3))
    source = absorb[..., None] * exact
    np.testing.assert_allclose(solve_screened(absorb, source), dense(absorb, source), atol=1)


def test_a_constant_is_its_own_solution() -> None:
    absorb = np.full(SHAPE, 10, np.float32)
    source = np.full((*SHAPE, 2), 10 * 7.0, np.float32)
    np.testing.assert_allclose(solve_screened(absorb, source), 7, atol=0.05)


def test_without_any_weight_the_solution_is_zero() -> None:
    solution = solve_screened(np.zeros(SHAPE, np.float32), np.zeros((*SHAPE, 3), np.float32))
    np.testing.assert_array_equal(solution, 0)


@pytest.mark.parametrize("shape", [(16, 16), (17, 19), (30, 41)])
def test_the_shape_of_the_source_is_kept_for_any_size(shape: tuple[int, int]) -> None:
    absorb = np.ones(shape, np.float32)
    for channels in (1, 3):
        assert solve_screened(absorb, np.ones((*shape, channels), np.float32)).shape == (*shape, channels)
