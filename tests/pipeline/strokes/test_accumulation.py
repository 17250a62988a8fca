"""Temporal accumulation: random changes average out, motion is followed, other surfaces are not mixed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Flow, Frame
from pipeline.strokes.accumulation import ACCUMULATION, Painting, accumulate

SHAPE = (40, 60)


def noise(seed: int, deviation: float = 12) -> Frame:
    return np.clip(128 + np.random.default_rng(seed).normal(0, deviation, (*SHAPE, 3)), 0, 255).astype(np.uint8)


def flat(value: float = 100) -> Frame:
    return np.full((*SHAPE, 3), value, np.uint8)


def way(dx: float, dy: float) -> Flow:
    return np.full((*SHAPE, 2), (dx, dy), np.float32)


def test_a_still_picture_is_unchanged() -> None:
    picture = noise(1)
    past = [Painting(picture, flat(), way(0, 0))] * 3
    np.testing.assert_array_equal(accumulate(Painting(picture, flat(), way(0, 0)), past), picture)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_random_variation_falls_with_the_square_root(count: int) -> None:
    past = [Painting(noise(k), flat(), way(0, 0)) for k in range(count)]
    found = accumulate(Painting(noise(99), flat(), way(0, 0)), past).astype(float)
    assert found.std() == pytest.approx(12 / np.sqrt(count + 1), rel=0.05)
    assert found.mean() == pytest.approx(128, abs=1)


def test_paintings_are_advected_over_several_frames() -> None:
    """The picture moves 4 px to the right, then 2 px down, given in px of a picture half as large."""
    big = np.random.default_rng(3).integers(0, 255, (*(side + 40 for side in SHAPE), 3)).astype(np.uint8)

    def picture_at(x: int, y: int) -> Frame:
        return np.ascontiguousarray(big[20 - y : 20 - y + SHAPE[0], 20 - x : 20 - x + SHAPE[1]])

    small = np.full((SHAPE[0] // 2, SHAPE[1] // 2, 3), 50, np.uint8)

    def half(dx: float, dy: float) -> NDArray[np.float32]:
        return np.full((*small.shape[:2], 2), (dx / 2, dy / 2), np.float32)

    past = [Painting(picture_at(4, 0), small, half(-4, 0)), Painting(picture_at(0, 0), small, None)]
    found = accumulate(Painting(picture_at(4, 2), small, half(0, -2)), past)
    inner = (slice(6, -6), slice(8, -8))
    np.testing.assert_array_equal(found[inner], picture_at(4, 2)[inner])


@pytest.mark.parametrize(
    ("apart", "share"),
    [(0, 0.5), (ACCUMULATION.same / ACCUMULATION.weight, 0.5), (ACCUMULATION.other / ACCUMULATION.weight + 1, 0.0)],
)
def test_another_surface_is_not_blended(apart: float, share: float) -> None:
    other = flat(100)
    other[..., 0] = 100 + round(apart)
    found = accumulate(Painting(flat(200), flat(100), way(0, 0)), [Painting(flat(0), other, None)])
    np.testing.assert_allclose(found, 200 * (1 - share), atol=1)


def test_a_small_change_is_another_surface_where_attention_is_paid() -> None:
    """Attention is paid to the right half of the picture."""
    attention = np.array([[0, 0, 1, 1]], np.float32)
    closed = flat(100 + int(ACCUMULATION.other / (1 + ACCUMULATION.attention) / ACCUMULATION.weight) + 1)
    found = accumulate(Painting(flat(200), closed, way(0, 0), attention), [Painting(flat(0), flat(100), None)])
    assert (found[:, :20] == 100).all() and (found[:, 40:] == 200).all()


def test_pixels_from_outside_the_picture_are_not_blended() -> None:
    found = accumulate(Painting(flat(200), flat(), way(-10, 0)), [Painting(flat(0), flat(), None)])
    assert (found[:, :10] == 200).all() and (found[:, 11:] == 100).all()


def test_nothing_is_accumulated_across_a_cut() -> None:
    past = [Painting(flat(0), flat(), None), Painting(flat(0), flat(), None)]
    assert (accumulate(Painting(flat(200), flat(), None), past) == 200).all()
    assert (accumulate(Painting(flat(200), flat(), way(0, 0)), past) == 100).all(), "the second is beyond the cut"


def test_a_thing_that_moves_too_far_leaves_no_line() -> None:
    """A leg that was at the left, to which the flow leads from two columns of a wall: too thin for a window."""
    wall = np.full((240, 360, 3), 220, np.uint8)
    leg = wall.copy()
    leg[:, 40:60] = 130
    back = np.zeros((240, 360, 2), np.float32)
    back[:, 30:70, 0] = 60
    back[:, 200:202, 0] = -152, -148
    found = accumulate(Painting(wall, wall, back), [Painting(leg, leg, None)])
    assert found.min() == 220
