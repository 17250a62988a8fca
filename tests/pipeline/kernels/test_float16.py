"""Conversions to and from half precision give the bits that NumPy's give."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.kernels.float16 import to_half, to_single


def test_every_half_becomes_the_same_single() -> None:
    every = np.arange(1 << 16, dtype=np.uint16).view(np.float16)
    expected = every.astype(np.float32)
    np.testing.assert_array_equal(to_single(every), expected)
    number = ~np.isnan(expected)
    np.testing.assert_array_equal(to_half(expected[number]).view(np.uint16), every[number].view(np.uint16))


def test_singles_are_rounded_to_the_nearest_half_and_ties_to_even() -> None:
    rng = np.random.default_rng(0)
    halves = np.arange(0x7BFF, dtype=np.uint16).view(np.float16).astype(np.float32)
    between = (halves[:-1] + halves[1:]) / 2
    values = np.concatenate([
        between, np.nextafter(between, np.float32(0)), np.nextafter(between, np.float32(1e9)),
        rng.normal(0, 20, 50_000).astype(np.float32), np.float32([0, 65504, 65519, 65520, 1e9, 1e-9, np.inf]),
    ])  # fmt: skip
    with np.errstate(over="ignore"):
        for signed in (values, -values):
            np.testing.assert_array_equal(to_half(signed).view(np.uint16), signed.astype(np.float16).view(np.uint16))


@pytest.mark.parametrize("shape", [(), (0,), (5,), (0, 4, 2), (3, 4, 2), (2, 3, 4, 5)])
def test_shapes_stay(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).normal(size=shape).astype(np.float32)
    assert to_half(values).shape == shape and to_half(values).dtype == np.float16
    np.testing.assert_array_equal(to_single(values.astype(np.float16)), values.astype(np.float16).astype(np.float32))
    assert to_single(values) is values


def test_strided_arrays_are_converted() -> None:
    values = np.random.default_rng(2).normal(size=(8, 6, 2)).astype(np.float32)
    half = values.astype(np.float16)
    np.testing.assert_array_equal(to_single(half[::2, 1:, :1]), half[::2, 1:, :1].astype(np.float32))
    np.testing.assert_array_equal(to_half(values[1:, ::3]), values[1:, ::3].astype(np.float16))


def test_doubles_are_rounded_once() -> None:
    value = np.array([1 + 2.0**-11 + 2.0**-40])
    assert to_half(value) == np.float16(value[0]) != to_half(value.astype(np.float32))
