"""Small estimated velocities are set to 0 in static regions only."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.motion import motions_between, zero_still_velocity


def pictures(shift: int = 0, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    plain = np.repeat(np.repeat(rng.integers(40, 216, (12, 16)), 4, 0), 4, 1)
    shifted = np.roll(plain, shift, axis=1)
    first, second = (np.clip(p + rng.normal(0, noise, p.shape), 0, 255).astype(np.uint8) for p in (plain, shifted))
    return first, second


@pytest.mark.parametrize(("speed", "shift", "kept"), [(0.06, 0, 0), (0.4, 0, 0), (0.4, 4, 1), (0.8, 0, 1)])
def test_small_velocities_are_suppressed_where_the_pictures_agree(speed: float, shift: int, kept: int) -> None:
    first, second = pictures(shift)
    velocity = np.full((*first.shape, 2), (speed, 0), np.float32)
    moving = (zero_still_velocity(velocity, first, second) != 0).any(-1)
    assert abs(moving.mean() - kept) < 0.2


def test_a_uniform_part_of_a_fast_object_keeps_its_velocity() -> None:
    flat = np.full((40, 60), 128, np.uint8)
    velocity = np.full((40, 60, 2), (3.0, 1.0), np.float32)
    np.testing.assert_array_equal(zero_still_velocity(velocity, flat, flat), velocity)


def test_pixels_that_look_alike_are_visible_even_if_the_flows_disagree() -> None:
    first, second = pictures(noise=0)
    second[:, 40:] = 255 - second[:, 40:]
    plus, minus = np.zeros((*first.shape, 2), np.float32), np.full((*first.shape, 2), (3.0, 0.0), np.float32)
    minus[:, 20:] = 0
    by_flow = motions_between(plus, minus, 2.0)[0].visible
    by_both = motions_between(plus, minus, 2.0, (first, second))[0].visible
    assert not by_flow[:, :18].any()
    assert by_both[:, :18].all()
    assert by_both[:, 44:].all(), "the flows agree there"


def test_pixels_that_look_different_are_hidden_where_the_flows_disagree() -> None:
    first, _ = pictures(noise=0)
    plus, minus = np.zeros((*first.shape, 2), np.float32), np.full((*first.shape, 2), (3.0, 0.0), np.float32)
    forth, _ = motions_between(plus, minus, 2.0, (first, 255 - first))
    assert forth.visible.mean() < 0.1


def test_a_pixel_that_leaves_the_picture_is_hidden_whatever_it_looks_like() -> None:
    flat = np.full((40, 60), 128, np.uint8)
    right = np.full((40, 60, 2), (30.0, 0.0), np.float32)
    forth, _ = motions_between(right, right, 2.0, (flat, flat))
    assert forth.visible[:, :29].all()
    assert not forth.visible[:, 31:].any()
