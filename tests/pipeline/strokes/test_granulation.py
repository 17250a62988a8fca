"""Grain that goes with what it paints: carried by the motion, begun anew unseen, as strong as ever."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.strokes.emboss import settle_pigment
from pipeline.strokes.granulation import PERIOD, Slips, carry_slips, shares_of

SHAPE = (24, 32)


def way(dx: float, dy: float) -> np.ndarray:
    return np.full((*SHAPE, 2), (dx, dy), np.float32)


def carried(frames: int, dx: float, dy: float, first: int = 1) -> Slips:
    slips = None
    for number in range(first, first + frames):
        slips = carry_slips(slips, way(dx, dy), number, 4.0)
    assert slips is not None
    return slips


def dried(slips: Slips | None, number: int, value: int = 60) -> np.ndarray:
    picture = np.full((64, 96, 3), value, np.uint8)
    wide = None if slips is None else np.ascontiguousarray(np.broadcast_to(slips[12, 16], (64, 96, 4)))
    return settle_pigment(picture, np.zeros((64, 96), np.float32), 0.2, wide, shares_of(number))[..., 0]


def test_where_nothing_moves_the_sheet_lies_still() -> None:
    assert not carried(20, 0, 0).any()
    np.testing.assert_array_equal(dried(carried(20, 0, 0), 20), dried(None, 20))


def test_grain_goes_with_the_motion() -> None:
    """By 2 px a frame of the frame: what is seen at x was seen 10 px to the left of it five frames before."""
    still, moved = dried(None, 0), dried(carried(5, -0.5, 0), 5)
    np.testing.assert_allclose(moved[:, 10:].astype(int), still[:, :-10].astype(int), atol=1)


def test_a_phase_begins_anew_when_it_is_not_seen() -> None:
    for number in range(1, 3 * PERIOD):
        one, two = shares_of(number)
        assert one + two == pytest.approx(1) and min(one, two) >= 0
        slips = carried(number, 0.25, 0.1)
        if not slips[..., :2].any():
            assert one == 0
        if not slips[..., 2:].any():
            assert two == 0
        assert np.abs(slips).max() <= PERIOD, "no phase is stretched by more than a period's motion"


def test_two_phases_have_the_contrast_of_one() -> None:
    plain = dried(None, 0).std()
    for number in (PERIOD // 4, PERIOD // 2 + 3, PERIOD):
        assert dried(carried(number, 0.53, 0.31), number).std() == pytest.approx(plain, rel=0.25)
