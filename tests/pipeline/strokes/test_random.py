"""Philox, compared with its published values, and the random numbers of strokes."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.strokes.random import Purpose, draws, philox

ANSWERS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
"""The known answers of Random123 for Philox 4x32-10."""


@pytest.mark.parametrize(("counter", "key", "answer"), ANSWERS)
def test_philox_gives_its_published_values(
    counter: tuple[int, ...], key: tuple[int, ...], answer: tuple[int, ...]
) -> None:
    assert tuple(int(word) for word in philox(*counter, *key)) == answer


def test_draws_depend_on_the_id_only() -> None:
    ids = np.arange(1000, dtype=np.uint64) << np.uint64(30)
    rotated = draws(ids[::-1].copy(), 3, Purpose.COLOUR)[::-1]
    np.testing.assert_array_equal(rotated, draws(ids, 3, Purpose.COLOUR))


def test_draws_of_different_seeds_and_purposes_are_independent() -> None:
    ids = np.arange(4000, dtype=np.uint64)
    sets = [draws(ids, seed, purpose)[:, 0] for seed in (0, 1) for purpose in (Purpose.COLOUR, Purpose.ORDER)]
    assert np.abs(np.corrcoef(sets) - np.eye(4)).max() < 0.06


def test_draws_are_uniform_in_0_to_1() -> None:
    values = draws(np.arange(20_000, dtype=np.uint64), 5, Purpose.PLACE)
    assert values.min() >= 0 and values.max() < 1
    counts = np.histogram(values, 16, (0, 1))[0]
    assert np.abs(counts / counts.mean() - 1).max() < 0.05
