"""Order statistics equal those of a complete sort."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.kernels.selection import column_medians, nth_smallest, upper_median

CHANCE = np.random.default_rng(4)


@pytest.mark.parametrize(
    "values",
    [
        CHANCE.normal(size=1001),
        np.maximum(CHANCE.normal(size=1000), 0),
        np.round(CHANCE.normal(size=(40, 30))) * -1,
        np.array([3.5]),
        np.array([-1e-45, 1e-45, -3e38, 3e38, 0.0, -0.0, np.inf, -np.inf]),
    ],
    ids=["different", "half of them 0", "steps with -0", "one", "extremes"],
)
def test_every_place_equals_that_of_a_sort(values: NDArray[np.float64]) -> None:
    single = values.astype(np.float32)
    expected = np.sort(single, axis=None)
    found = [nth_smallest(single, n) for n in range(single.size)]
    np.testing.assert_array_equal(found, expected)


def test_an_array_with_steps_between_its_elements_is_read_as_it_looks() -> None:
    values = CHANCE.normal(size=(30, 20, 2)).astype(np.float32)
    assert nth_smallest(values[::3, ::2, 1], 7) == np.sort(values[::3, ::2, 1], axis=None)[7]


def test_the_median_of_an_even_number_is_the_upper_one() -> None:
    assert upper_median(np.array([4, 1, 3, 2], np.float32)) == 3


def test_medians_of_columns() -> None:
    values = CHANCE.normal(size=(11, 7, 3)).astype(np.float32)
    np.testing.assert_array_equal(column_medians(values), np.median(values.reshape(-1, 3), axis=0))
