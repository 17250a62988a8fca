"""Temporal coherence of lines: hysteresis over whole strokes, and advection along the flow."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.lines.coherent import Ink, PreviousInk, StrokeLimits, keep_strokes, warp_forward

SHAPE = (40, 60)
WEAK, STRONG = 64, 153
LIMITS = StrokeLimits(WEAK, STRONG, 12.0)


def stroke(length: int, level: int, y: int = 20, x: int = 10) -> Ink:
    ink = np.zeros(SHAPE, np.uint8)
    ink[y, x : x + length] = level
    return ink


def kept(ink: Ink, past: PreviousInk | None = None, importance: float = 0.0) -> NDArray[np.bool_]:
    made = keep_strokes(ink, past, np.full(ink.shape, importance, np.float32), LIMITS)
    assert made.dtype == np.uint8 and set(np.unique(made)) <= {0, 255}
    return made > 0


def drawn_before(ink: Ink, dx: float = 0.0, dy: float = 0.0) -> PreviousInk:
    return PreviousInk(ink, np.tile(np.array([dx, dy], np.float32), (*ink.shape, 1)))


def test_a_stroke_is_kept_whole_if_it_is_strong_somewhere() -> None:
    ink = stroke(20, 90)
    ink[20, 15] = 200
    np.testing.assert_array_equal(kept(ink), ink > 0)
    assert not kept(stroke(20, 90)).any()


def test_ink_below_the_weak_threshold_belongs_to_no_stroke() -> None:
    ink = stroke(20, 200)
    ink[20, 18] = WEAK
    found = kept(ink)
    assert not found[20, 10:19].any() and not found[20, 18]
    assert not found[20, 19:].any(), "eleven pixels are too short"


@pytest.mark.parametrize(("length", "stays"), [(11, False), (12, True)])
def test_specks_are_not_drawn(length: int, stays: bool) -> None:
    assert bool(kept(stroke(length, 200)).any()) is stays
    assert bool(kept(np.ascontiguousarray(stroke(length, 200, y=2, x=2)[:30, :30].T)).any()) is stays


def test_among_many_short_strokes_only_longer_ones_are_drawn() -> None:
    ink = np.zeros((70, 130), np.uint8)
    ink[2:60:6, 4:18] = 200  # ten strokes of 14 px
    ink[2:60:6, 24:38] = 200  # ten more beside them
    ink[2:60:6, 110:124] = np.where(np.arange(10) == 3, 200, 0)[:, None]  # one that stands alone
    ink[64, 4:44] = 200  # a long one below
    found = kept(ink)
    assert not found[:60, :40].any()
    np.testing.assert_array_equal(found[:, 100:], ink[:, 100:] > 0)
    np.testing.assert_array_equal(found[64], ink[64] > 0)


def test_a_diagonal_is_one_stroke() -> None:
    ink = np.zeros(SHAPE, np.uint8)
    np.fill_diagonal(ink[5:20, 5:20], 200)
    assert kept(ink).sum() == 15


def test_a_short_stroke_is_drawn_where_importance_is_high() -> None:
    """A quarter of the length is enough at importance 1: an eye is short."""
    assert kept(stroke(3, 200), importance=1.0).any()
    assert not kept(stroke(2, 200), importance=1.0).any()


def test_a_weak_stroke_is_kept_where_a_stroke_was_drawn_before() -> None:
    weak = stroke(20, 90)
    assert not kept(weak).any()
    assert kept(weak, drawn_before(stroke(20, 200))).sum() == 20
    assert not kept(weak, drawn_before(stroke(20, 200, y=30))).any()


def test_a_stroke_that_was_drawn_before_may_have_a_third_of_the_length() -> None:
    past = drawn_before(stroke(20, 200))
    assert kept(stroke(4, 200), past).any() and not kept(stroke(3, 200), past).any()


def test_a_quarter_of_a_stroke_must_have_been_drawn_before() -> None:
    weak = stroke(20, 90)
    assert not kept(weak, drawn_before(stroke(5, 200))).any()
    assert kept(weak, drawn_before(stroke(6, 200))).any()


def test_previous_ink_is_looked_up_along_the_motion() -> None:
    weak = stroke(20, 90, y=20, x=30)
    before = stroke(20, 200, y=14, x=22)
    assert kept(weak, drawn_before(before, 8, 6)).any()
    assert not kept(weak, drawn_before(before)).any()


def test_a_blank_picture_has_no_strokes() -> None:
    assert not kept(np.zeros(SHAPE, np.uint8)).any()
    assert not kept(np.zeros(SHAPE, np.uint8), drawn_before(stroke(20, 200))).any()


def test_a_line_that_fluctuates_about_the_strong_threshold_does_not_flicker() -> None:
    rng = np.random.default_rng(1)
    past: PreviousInk | None = None
    independent, coherent = [], []
    for _ in range(30):
        ink = stroke(20, int(rng.integers(STRONG - 40, STRONG + 40)))
        independent.append(bool(kept(ink).any()))
        found = kept(ink, past)
        coherent.append(bool(found.any()))
        past = drawn_before(np.where(found, ink, 0).astype(np.uint8))
    assert sum(a != b for a, b in pairwise(independent)) > 5
    assert sum(a != b for a, b in pairwise(coherent)) <= 1


def test_advect_moves_a_plane_along_the_flow() -> None:
    plane = np.random.default_rng(0).uniform(0, 1, SHAPE).astype(np.float32)
    whole = np.tile(np.array([3, -2], np.float32), (*SHAPE, 1))
    np.testing.assert_allclose(warp_forward(plane, whole)[:-2, 3:], plane[2:, :-3])
    half = np.tile(np.array([0.5, 0], np.float32), (*SHAPE, 1))
    np.testing.assert_allclose(warp_forward(plane, half)[:, 1:], (plane[:, 1:] + plane[:, :-1]) / 2, atol=1e-6)
    np.testing.assert_array_equal(warp_forward(plane, np.zeros((*SHAPE, 2), np.float32)), plane)
