"""Small estimated velocities are set to 0 in static regions only."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.motion import suppress_small_motion


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
    moving = (suppress_small_motion(velocity, first, second) != 0).any(-1)
    assert abs(moving.mean() - kept) < 0.2


def test_a_uniform_part_of_a_fast_object_keeps_its_velocity() -> None:
    flat = np.full((40, 60), 128, np.uint8)
    velocity = np.full((40, 60, 2), (3.0, 1.0), np.float32)
    np.testing.assert_array_equal(suppress_small_motion(velocity, flat, flat), velocity)
