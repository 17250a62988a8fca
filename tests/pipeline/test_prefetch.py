"""Hints for the processor: kernels with them compile, and give the same results."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.jit import kernel
from pipeline.prefetch import prefetch


@kernel
def _sum_in_order(values: NDArray[np.float32], order: NDArray[np.intp]) -> np.float32:
    total = np.float32(0)
    for turn in range(len(order)):
        prefetch(values, np.uintp(order[turn] + 1000))  # beyond the array, too
        total += values[order[turn]]
    return total


def test_kernels_with_hints_give_the_same_results() -> None:
    values = np.arange(100, dtype=np.float32)
    assert _sum_in_order(values, np.arange(99, -1, -1)) == values.sum()


def test_outside_of_kernels_a_hint_does_nothing() -> None:
    values = np.ones(3, np.float32)
    prefetch(values, 1)
    assert (values == 1).all()
