"""The solver of Laplace's equation, on systems whose solutions are known."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Mask, Plane
from pipeline.solvers import Multigrid, Solution
from pipeline.solvers.grid import build_levels

ODD = (23, 31)
Numbers: TypeAlias = NDArray[Any]


def solve(
    values: Numbers, fixed: Mask, *, right: Numbers | None = None, down: Numbers | None = None,
    absorb: Numbers | None = None, **options: Any,
) -> Solution:  # fmt: skip
    """Set up the matrix and solve it once."""
    return Multigrid(fixed, right=right, down=down, absorb=absorb).solve(values, **options)


def blobs(shape: tuple[int, int], count: int, seed: int) -> tuple[Plane, Mask]:
    """Random ragged regions of given pixels, each with a value in -1..1."""
    rng = np.random.default_rng(seed)
    values, fixed = np.zeros(shape, np.float32), np.zeros(shape, bool)
    y, x = np.indices(shape)
    for _ in range(count):
        a, b = rng.uniform(1.5, 1.5 + max(shape) / 8, 2)
        angle, cy, cx = rng.uniform(0, math.pi), rng.uniform(0, shape[0]), rng.uniform(0, shape[1])
        s, t = math.sin(angle), math.cos(angle)
        out = (((x - cx) * t + (y - cy) * s) / a) ** 2 + (((y - cy) * t - (x - cx) * s) / b) ** 2
        region = out + rng.normal(0, 0.1, shape) < 1
        region[min(int(cy), shape[0] - 1), min(int(cx), shape[1] - 1)] = True
        fixed |= region
        values[region] = rng.uniform(-1, 1)
    return values, fixed


def edges(shape: tuple[int, int], seed: int) -> tuple[Numbers, Numbers]:
    """Random edge weights that differ by a factor of up to 1000."""
    rng = np.random.default_rng(seed)
    right, down = rng.uniform(-7, 0, (shape[0], shape[1] - 1)), rng.uniform(-7, 0, (shape[0] - 1, shape[1]))
    return np.exp(right).astype(np.float32), np.exp(down).astype(np.float32)


def direct(values: Plane, fixed: Mask, right: Numbers, down: Numbers, absorb: Numbers, source: Numbers) -> Numbers:
    """Solution of the same system by sparse elimination."""
    import scipy.sparse.linalg  # type: ignore[import-untyped]

    place = np.arange(fixed.size).reshape(fixed.shape)
    a = np.concatenate([place[:, :-1].ravel(), place[:-1].ravel()])
    b = np.concatenate([place[:, 1:].ravel(), place[1:].ravel()])
    weights = np.concatenate([right.ravel(), down.ravel()]).astype(np.float64)
    near = scipy.sparse.coo_matrix((weights, (a, b)), (fixed.size, fixed.size))
    near = (near + near.T).tocsr()
    matrix = scipy.sparse.diags(np.asarray(near.sum(1)).ravel() + absorb.ravel()) - near
    free = ~fixed.ravel()
    known = np.where(fixed, values, 0).ravel().astype(np.float64)
    x = known.copy()
    pull = source.ravel() - matrix @ known
    x[free] = scipy.sparse.linalg.spsolve(matrix[free][:, free].tocsc(), pull[free])
    return x.reshape(fixed.shape)


@pytest.mark.parametrize("shape", [ODD, (16, 16), (1, 40), (40, 1), (2, 7)])
@pytest.mark.parametrize("weighted", [False, True])
def test_the_solution_equals_sparse_elimination(shape: tuple[int, int], weighted: bool) -> None:
    values, fixed = blobs(shape, 3, seed=5)
    right, down = (
        edges(shape, 1) if weighted else (np.ones((shape[0], shape[1] - 1)), np.ones((shape[0] - 1, shape[1])))
    )
    rng = np.random.default_rng(2)
    absorb = np.where(rng.random(shape) < 0.1, 0.5, 0).astype(np.float32)
    source = absorb * rng.uniform(-1, 1, shape).astype(np.float32)
    found = solve(values, fixed, right=right, down=down, absorb=absorb, source=source, tolerance=1e-9)
    np.testing.assert_allclose(found.x, direct(values, fixed, right, down, absorb, source), atol=1e-4)


def harmonic(cells: int) -> tuple[float, float]:
    """Error and cycles for e^x cos y on the unit square, its values given around it, `cells` to a side."""
    y, x = np.indices((cells + 1, cells + 1)) / cells
    truth = np.exp(2 * x) * np.cos(2 * y)
    fixed = np.ones(truth.shape, bool)
    fixed[1:-1, 1:-1] = False
    found = solve(truth, fixed, tolerance=1e-11)
    return float(np.abs(found.x - truth).max()), found.cycles


def test_halving_the_grid_quarters_the_error() -> None:
    coarse, fine, finer = (harmonic(cells)[0] for cells in (6, 12, 24))
    assert math.log2(coarse / fine) == pytest.approx(2, abs=0.25)
    assert math.log2(fine / finer) == pytest.approx(2, abs=0.25)


def test_a_plane_between_two_sides_is_reproduced_and_borders_mirror() -> None:
    values = np.broadcast_to(np.linspace(0, 1, 41, dtype=np.float32), (17, 41))
    fixed = np.zeros((17, 41), bool)
    fixed[:, [0, -1]] = True
    np.testing.assert_allclose(solve(values, fixed, tolerance=1e-8).x, values, atol=1e-6)


@pytest.mark.parametrize("shape", [(93, 127), (180, 320), (241, 161)])
@pytest.mark.parametrize("count", [1, 4, 15])
def test_twelve_cycles_give_six_digits(shape: tuple[int, int], count: int) -> None:
    for seed in range(3):
        found = solve(*blobs(shape, count, seed))
        assert found.residual <= 1e-6
        assert found.cycles <= 12
        assert list(found.residuals[0]) == sorted(found.residuals[0], reverse=True)


@pytest.mark.parametrize("pattern", ["pixel", "checks", "stripes", "salt", "maze"])
def test_twelve_cycles_suffice_for_ragged_regions(pattern: str) -> None:
    shape = (125, 187)
    y, x = np.indices(shape)
    fixed = {
        "pixel": (y == 60) & (x == 3),
        "checks": (y // 9 + x // 9) % 2 == 0,
        "stripes": y % 2 == 0,
        "salt": np.random.default_rng(1).random(shape) < 0.02,
        "maze": (y % 8 == 0) & (x % 40 > 3) | (x % 40 == 0) & (y % 8 < 5),
    }[pattern]
    values = np.random.default_rng(2).uniform(-1, 1, shape).astype(np.float32)
    assert solve(values, fixed).cycles <= 12


@pytest.mark.parametrize(("part", "most"), [(0.5, 12), (0.05, 20)])
def test_a_random_walk_with_ragged_borders_converges(part: float, most: int) -> None:
    """Objects that move differently, noisy flow, links to other frames at a part of the pixels."""
    shape = (125, 187)
    rng = np.random.default_rng(8)
    motion = 8 * blobs(shape, 30, seed=8)[0] + rng.normal(0, 0.15, shape)
    right, down = (np.exp(-np.abs(np.diff(motion, axis=axis))) for axis in (1, 0))
    links = (rng.random(shape) < part) * rng.random(shape)
    values, fixed = blobs(shape, 5, seed=9)
    found = solve(values, fixed, right=right, down=down, absorb=links, source=links)
    assert found.residual <= 1e-6
    assert found.cycles <= most


def test_the_reported_residual_is_correct() -> None:
    values, fixed = blobs(ODD, 3, seed=4)
    found = solve(values, fixed)
    x = np.pad(found.x.astype(np.float64), 1, mode="edge")
    left = 4 * x[1:-1, 1:-1] - x[:-2, 1:-1] - x[2:, 1:-1] - x[1:-1, :-2] - x[1:-1, 2:]
    assert np.abs(left[~fixed]).max() < 1e-5
    assert found.residuals[0][0] == 1
    assert found.residuals[0][-1] == found.residual <= 1e-6


def test_probabilities_equal_scikit_image_random_walker() -> None:
    from skimage.segmentation import random_walker

    shape, beta = (21, 27), 90.0
    blocks, _ = blobs(shape, 6, seed=12)
    picture = blocks.astype(np.float64) + np.random.default_rng(3).normal(0, 0.05, shape)
    seeds = np.zeros(shape, np.int64)
    seeds[2:4, 2:4], seeds[15, 20], seeds[18, 3:9] = 1, 2, 3
    expected = random_walker(picture, seeds, beta=beta, mode="cg_j", tol=1e-8, return_full_prob=True)
    scale = beta / (10 * picture.std())  # as scikit-image weighs its edges
    right = np.exp(-scale * np.diff(picture, axis=1) ** 2)
    down = np.exp(-scale * np.diff(picture, axis=0) ** 2)
    labels = np.stack([seeds == label for label in (1, 2, 3)]).astype(np.float32)
    found = Multigrid(seeds > 0, right=right, down=down).solve(labels)
    np.testing.assert_allclose(found.x, expected, atol=1e-3)
    np.testing.assert_allclose(found.x.sum(0), 1, atol=1e-5)


def test_an_absorbing_term_is_an_edge_to_a_given_pixel() -> None:
    """A row that absorbs is as good as another row, given, beyond it: the links between frames of a random walk."""
    values, fixed = blobs(ODD, 2, seed=3)
    weight = np.zeros(ODD, np.float32)
    weight[-1] = np.random.default_rng(1).uniform(0, 2, ODD[1])
    bound = np.full(ODD, 0.25, np.float32)
    found = solve(values, fixed, absorb=weight, source=weight * bound)
    more = np.pad(values, ((0, 1), (0, 0)))
    more[-1] = 0.25
    down = np.ones(ODD, np.float32)
    down[-1] = weight[-1]
    expected = solve(more, np.pad(fixed, ((0, 1), (0, 0)), constant_values=True), down=down)
    np.testing.assert_allclose(found.x, expected.x[:-1], atol=2e-6)


@pytest.mark.parametrize("tolerance", [0.5, 1e-2, 1e-6])
def test_the_solution_stays_in_the_range_of_given_values(tolerance: float) -> None:
    values, fixed = blobs((61, 83), 4, seed=6)
    x = solve(values, fixed, tolerance=tolerance).x
    assert x.min() >= values[fixed].min()
    assert x.max() <= values[fixed].max()
    np.testing.assert_array_equal(x[fixed], values[fixed])


def test_labels_are_solved_independently() -> None:
    values, fixed = blobs((41, 57), 5, seed=7)
    many = np.stack([values, values**2, np.zeros_like(values), np.ones_like(values)])
    absorb = np.full(values.shape, 0.01, np.float32)
    matrix = Multigrid(fixed, absorb=absorb)
    together = matrix.solve(many, source=absorb)
    for one, alone in zip(together.x, many, strict=True):
        assert one.tobytes() == matrix.solve(alone, source=absorb).x.tobytes()
    assert together.cycles == max(matrix.solve(alone, source=absorb).cycles for alone in many)


def test_the_previous_solution_reduces_the_cycles() -> None:
    values, fixed = blobs((93, 127), 5, seed=7)
    matrix = Multigrid(fixed)
    first = matrix.solve(values)
    nearly = matrix.solve(values + np.float32(0.0005) * np.sign(values), start=first.x)
    assert nearly.cycles <= first.cycles - 2
    assert nearly.residuals[0][0] < 0.01
    np.testing.assert_allclose(nearly.x, matrix.solve(values + np.float32(0.0005) * np.sign(values)).x, atol=1e-5)


def test_unreachable_pixels_take_the_fallback() -> None:
    fixed = np.zeros((20, 30), bool)
    fixed[4:8, 3:9] = True
    right = np.ones((20, 29), np.float32)
    right[:, 14] = 0
    values = np.where(fixed, 0.5, np.nan)
    matrix = Multigrid(fixed, right=right)
    found = matrix.solve(values, start=np.full((20, 30), 9.0), fallback=-3)
    assert matrix.undetermined[:, 15:].all()
    assert not matrix.undetermined[:, :15].any()
    assert (found.x[:, 15:] == -3).all()
    np.testing.assert_allclose(found.x[:, :15], 0.5, atol=1e-6)


def test_no_given_pixels() -> None:
    found = solve(np.zeros((5, 6)), np.zeros((5, 6), bool))
    assert not found.x.any()
    assert found.cycles == 0


def test_all_pixels_given() -> None:
    values = np.random.default_rng(1).uniform(size=(5, 6)).astype(np.float32)
    np.testing.assert_array_equal(solve(values, np.ones((5, 6), bool)).x, values)


def test_work_is_linear_in_pixels() -> None:
    """The cost is given by the pixels of all grids together and the number of cycles."""
    for side in (33, 130, 517):
        stencil = np.zeros((5, side + 2, side + 2))
        work = build_levels(stencil).sizes.prod(axis=1).sum() / side**2
        assert work < 1.34 + 12 / math.sqrt(side)
    cycles = [solve(*blobs((side, side), 4, seed=2)).cycles for side in (33, 130, 517)]
    assert max(cycles) <= 6


def test_memory_layout_does_not_change_the_result() -> None:
    values, fixed = blobs(ODD, 3, seed=4)
    expected = solve(values, fixed).x.tobytes()
    assert solve(values, fixed).x.tobytes() == expected
    assert solve(np.asfortranarray(values), np.asfortranarray(fixed)).x.tobytes() == expected


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"right": np.ones((5, 6))}, "right"),
        ({"down": -np.ones((4, 6))}, "down"),
        ({"absorb": np.full((5, 6), np.nan)}, "absorb"),
        ({"source": np.ones((3, 5, 6))}, "source"),
        ({"start": np.full((5, 6), np.inf)}, "start"),
        ({"values": np.ones((5, 5))}, "values"),
        ({"values": np.full((5, 6), np.nan)}, "values"),
        ({"fixed": np.ones((5, 6))}, "fixed"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"max_cycles": 0}, "max_cycles"),
    ],
)
def test_an_invalid_argument_is_named(change: dict[str, object], field: str) -> None:
    arguments: dict[str, object] = {"values": np.ones((5, 6)), "fixed": np.eye(5, 6, dtype=bool)} | change
    with pytest.raises(BadParameter) as caught:
        solve(**arguments)  # type: ignore[arg-type]
    assert caught.value.field == field


@pytest.mark.parametrize("seed", range(60))
def test_zero_weights_are_accepted(seed: int) -> None:
    """Barriers, weights over fifty decades, faint links: finite, and within what is given."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 30, 2))

    def weights(height: int, width: int) -> Numbers:
        any_one = rng.random((height, width))
        kinds = [
            (any_one < 0.5) * 1.0,
            np.exp(-40 * any_one),
            10 ** (50 * any_one - 30),
            np.where(any_one < 0.3, 0, 1e-38),
        ]
        return np.asarray(kinds[rng.integers(len(kinds))])

    fixed = rng.random(shape) < rng.choice([0, 0.01, 0.1, 0.5])
    absorb = np.where(rng.random(shape) < 0.1, 10 ** rng.uniform(-12, 3, shape), 0)
    values = rng.uniform(-1, 1, shape)
    matrix = Multigrid(
        fixed, right=weights(shape[0], shape[1] - 1), down=weights(shape[0] - 1, shape[1]), absorb=absorb
    )
    found = matrix.solve(values, source=absorb * values, fallback=0.5)
    assert np.abs(found.x).max() <= 1 + 1e-6
    assert found.residual <= 1e-4
    assert (found.x[matrix.undetermined] == 0.5).all()
