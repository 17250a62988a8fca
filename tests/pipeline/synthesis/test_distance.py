"""Distances are exact, and kernels agree with their specification."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.compute import device
from pipeline.synthesis.distance import distance, extrapolated, nearest, within_reach

SIZES = [(1, 1), (1, 9), (9, 1), (17, 23), (40, 31)]


def a_mask(size: tuple[int, int], share: float = 0.03) -> np.ndarray:
    return np.random.default_rng(size[0]).random(size) < share


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_distances_are_those_of_the_nearest_of_all(size: tuple[int, int]) -> None:
    mask = a_mask(size)
    mask[size[0] // 2, size[1] // 3] = True
    places = np.argwhere(mask)
    y, x = np.indices(size)
    squares = (y[..., None] - places[:, 0]) ** 2 + (x[..., None] - places[:, 1]) ** 2
    np.testing.assert_array_equal(distance(mask), np.sqrt(squares.min(-1).astype(np.float32)))


@pytest.mark.real("opencl")
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("share", [0, 0.03, 0.6])
def test_kernels_do_what_their_specification_says(size: tuple[int, int], share: float) -> None:
    mask = a_mask(size, share)
    np.testing.assert_array_equal(nearest(mask, device()), nearest(mask))


def test_where_nothing_is_set_everything_is_as_far_as_can_be() -> None:
    assert (distance(np.zeros((3, 4), bool)) == 5).all()


def test_a_field_goes_on_beyond_what_is_known_of_it() -> None:
    field = np.zeros((8, 10, 2), np.float32)
    field[:, 2], field[:, 7] = (1, 2), (3, 4)
    known = np.zeros((8, 10), bool)
    known[:, [2, 7]] = True
    found = extrapolated(field, nearest(known))
    assert (found[:, :5] == (1, 2)).all() and (found[:, 5:] == (3, 4)).all()
    assert (extrapolated(field, nearest(np.zeros_like(known))) == 0).all()


@pytest.mark.real("opencl")
@pytest.mark.parametrize("reach", [1, 4])
def test_beyond_its_reach_nothing_is_found(reach: int) -> None:
    mask = a_mask((40, 31), 0.01)
    found = nearest(mask, reach_px=reach)
    np.testing.assert_array_equal(found[..., 0] >= 0, distance(mask) <= reach)
    np.testing.assert_array_equal(found, nearest(mask, device(), reach))
    np.testing.assert_array_equal(within_reach(nearest(mask), reach), distance(mask) <= reach)
