"""Positions of set pixels, with and without the eight-at-a-time shortcut."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.kernels.nonzero import nonzero_positions


@pytest.mark.parametrize("length", [0, 1, 7, 8, 9, 64, 100])
@pytest.mark.parametrize("share", [0.0, 0.05, 1.0])
def test_places_are_those_of_the_set_flags_after_what_is_there(length: int, share: float) -> None:
    flags = (np.random.default_rng(length).random(length) < share).astype(np.uint8) * np.uint8(255)
    places = np.full(length + 3, -1, np.int32)
    count = nonzero_positions(flags, places, 1000, 2)
    assert count == 2 + np.count_nonzero(flags)
    np.testing.assert_array_equal(places[2:count], 1000 + np.flatnonzero(flags))
    assert (places[:2] == -1).all()
