"""Temporal blending of flat colours: borders move smoothly, flat areas stay flat."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.colour.memory import BLEND, blend_colours

SHAPE = (10, 20)
WEIGHTS = np.where(np.arange(256) < 255, 128, 0).astype(np.int32)


def halves(border: int = 10) -> np.ndarray:
    picture = np.full((*SHAPE, 3), 40, np.uint8)
    picture[:, border:] = 200
    return picture


def blended(past: np.ndarray, speed_px: float = 0, residual: int = 0) -> np.ndarray:
    flow = np.zeros((*SHAPE, 2), np.float32)
    flow[..., 0] = speed_px
    result = past.copy()
    blend_colours(halves(), result, np.full(SHAPE, residual, np.uint8), flow, WEIGHTS)
    return result


def test_a_border_moves_by_the_weight() -> None:
    made = blended(halves(11))
    assert (made[:, 10] == pytest.approx(120, abs=1)) and (made[:, 11:] == 200).all() and (made[:, :10] == 40).all()


def test_nothing_of_the_past_remains_inside_a_region() -> None:
    made = blended(np.full((*SHAPE, 3), 120, np.uint8))
    far = BLEND.reach_px
    np.testing.assert_array_equal(made[:, : 10 - far], halves()[:, : 10 - far])
    np.testing.assert_array_equal(made[:, 10 + far :], halves()[:, 10 + far :])


def test_the_past_has_no_weight_where_something_is_fast_or_differs() -> None:
    for made in (blended(halves(11), speed_px=BLEND.fast_px), blended(halves(11), residual=255)):
        np.testing.assert_array_equal(made, halves())
