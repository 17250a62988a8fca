"""Order statistics in linear time, whatever the values are.

`numpy.partition` takes up to eight times as long where many values are equal, such as the zeros of a flow at rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel

_DIGITS = ((21, 2047), (10, 2047), (0, 1023))
"""Shift and mask of the digits of a number of 32 bits, from the most significant one on."""


def nth_smallest(values: NDArray[np.float32], n: int) -> np.float32:
    """The value that has the index `n` after sorting.

    Args:
        values: float32, any shape, without NaN.
        n: 0..size - 1.
    """
    return np.float32(_nth_smallest(np.ascontiguousarray(values, np.float32).reshape(-1).view(np.uint32), n))


def upper_median(values: NDArray[np.float32]) -> np.float32:
    """The median of an array, float32, any shape, not empty, without NaN; of an even number of values the larger one of
    the two in the middle."""
    return nth_smallest(values, values.size // 2)


def column_medians(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """The `upper_median` of each column of an array (..., n), float32 (n,)."""
    return np.asarray(_column_medians(np.ascontiguousarray(rows, np.float32).reshape(-1, rows.shape[-1])))


@kernel
def _column_medians(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    count, columns = rows.shape
    medians, values = np.empty(columns, np.float32), np.empty(count, np.float32)
    for column in range(columns):
        for row in range(count):
            values[row] = rows[row, column]
        medians[column] = _nth_smallest(values.view(np.uint32), count // 2)
    return medians


@kernel
def _nth_smallest(bits: NDArray[np.uint32], n: int) -> np.float32:
    """Digit by digit: the numbers that have the digits known so far are counted by their next digit."""
    counts = np.zeros(2048, np.int64)
    known, above = np.uint32(0), np.uint32(0)  # the digits known so far, and a mask of their bits
    left = n
    for shift, mask in _DIGITS:
        counts[:] = 0
        for each in bits:
            key = _ordered(each)
            if key & above == known:
                counts[(key >> np.uint32(shift)) & np.uint32(mask)] += 1
        digit = 0
        while left >= counts[digit]:
            left -= counts[digit]
            digit += 1
        known |= np.uint32(digit) << np.uint32(shift)
        above |= np.uint32(mask) << np.uint32(shift)
    return _value(known)


@kernel
def _ordered(bits: np.uint32) -> np.uint32:
    """An unsigned number for the bits of a single-precision number: they have the same order."""
    sign = np.uint32(np.int32(bits) >> 31)
    return np.uint32(bits ^ (sign | np.uint32(0x80000000)))


@kernel
def _value(key: np.uint32) -> np.float32:
    """The number with that key, see `_ordered`."""
    bits = np.empty(1, np.uint32)
    bits[0] = key & np.uint32(0x7FFFFFFF) if key >> np.uint32(31) else ~key
    return np.float32(bits.view(np.float32)[0] + np.float32(0))  # not -0
