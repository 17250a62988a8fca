"""Conversions to and from half precision have NumPy's bits."""

from __future__ import annotations

import numpy as np

from pipeline.halves import to_half, to_single

_SPREAD = np.float32(10) ** np.linspace(-12, 4.8, 100_001, dtype=np.float32)
_SINGLES = np.concatenate([_SPREAD, -_SPREAD, np.array([0, -0.0, np.inf, -np.inf, 65504, 65519, 2.98e-8], np.float32)])


def test_singles_are_rounded_as_by_numpy() -> None:
    np.testing.assert_array_equal(to_half(_SINGLES).view(np.uint16), _SINGLES.astype(np.float16).view(np.uint16))


def test_every_half_has_its_single() -> None:
    halves = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    numbers = halves[~np.isnan(halves)]
    np.testing.assert_array_equal(to_single(numbers).view(np.uint32), numbers.astype(np.float32).view(np.uint32))


def test_shapes_and_strides() -> None:
    planes = np.random.default_rng(3).normal(size=(2, 6, 8)).astype(np.float32).transpose(1, 2, 0)[::2]
    assert to_half(planes).dtype == np.float16 and to_half(planes).flags.c_contiguous
    np.testing.assert_array_equal(to_half(planes), planes.astype(np.float16))
    np.testing.assert_array_equal(to_single(planes.astype(np.float16)), planes.astype(np.float16).astype(np.float32))
    assert to_half(np.empty((0, 3), np.float32)).shape == to_single(np.empty((0, 3), np.float16)).shape == (0, 3)


def test_doubles_are_rounded_once() -> None:
    value = np.array([1 + 2.0**-11 + 2.0**-40])
    assert to_half(value) == np.float16(value[0]) != to_half(value.astype(np.float32))
