"""Distances are exact, and kernels equal the reference implementation."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.compute import device
from pipeline.synthesis.distance import distance, extrapolated, nearest, within_reach

SIZES = [(1, 1), (1, 9), (9, 1), (17, 23), (40, 31)]


def random_mask(size: tuple[int, int], share: float = 0.03) -> np.ndarray:
    return np.random.default_rng(size[0]).random(size) < share


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_distances_are_exact(size: tuple[int, int]) -> None:
    mask = random_mask(size)
    mask[size[0] // 2, size[1] // 3] = True
    places = np.argwhere(mask)
    y, x = np.indices(size)
    squares = (y[..., None] - places[:, 0]) ** 2 + (x[..., None] - places[:, 1]) ** 2
    np.testing.assert_array_equal(distance(mask), np.sqrt(squares.min(-1).astype(np.float32)))


@pytest.mark.real("opencl")
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("share", [0, 0.03, 0.6])
def test_kernels_equal_the_reference(size: tuple[int, int], share: float) -> None:
    mask = random_mask(size, share)
    np.testing.assert_array_equal(nearest(mask, device()), nearest(mask))


def test_without_known_pixels_the_distance_is_the_diagonal() -> None:
    assert (distance(np.zeros((3, 4), bool)) == 5).all()


def test_a_field_is_extrapolated_from_the_nearest_known_pixel() -> None:
    field = np.zeros((8, 10, 2), np.float32)
    field[:, 2], field[:, 7] = (1, 2), (3, 4)
    known = np.zeros((8, 10), bool)
    known[:, [2, 7]] = True
    found = extrapolated(field, nearest(known))
    assert (found[:, :5] == (1, 2)).all() and (found[:, 5:] == (3, 4)).all()
    assert (extrapolated(field, nearest(np.zeros_like(known))) == 0).all()


@pytest.mark.real("opencl")
@pytest.mark.parametrize("reach", [1, 4])
def test_pixels_beyond_the_reach_have_no_nearest_pixel(reach: int) -> None:
    mask = random_mask((40, 31), 0.01)
    found = nearest(mask, reach_px=reach)
    np.testing.assert_array_equal(found[..., 0] >= 0, distance(mask) <= reach)
    np.testing.assert_array_equal(found, nearest(mask, device(), reach))
    np.testing.assert_array_equal(within_reach(nearest(mask), reach), distance(mask) <= reach)
