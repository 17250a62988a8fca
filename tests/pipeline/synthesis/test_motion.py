"""Velocities as synthesis wants them: nothing where nothing moves."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.synthesis.motion import suppress_small_motion


def pictures(shift: int = 0, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    plain = np.repeat(np.repeat(rng.integers(40, 216, (12, 16)), 4, 0), 4, 1)
    there = np.roll(plain, shift, axis=1)
    here, after = (np.clip(p + rng.normal(0, noise, p.shape), 0, 255).astype(np.uint8) for p in (plain, there))
    return here, after


@pytest.mark.parametrize(("speed", "shift", "stays"), [(0.06, 0, 0), (0.4, 0, 0), (0.4, 4, 1), (0.8, 0, 1)])
def test_what_barely_moves_stands_still_where_the_pictures_agree(speed: float, shift: int, stays: int) -> None:
    here, there = pictures(shift)
    velocity = np.full((*here.shape, 2), (speed, 0), np.float32)
    moving = (suppress_small_motion(velocity, here, there) != 0).any(-1)
    assert abs(moving.mean() - stays) < 0.2


def test_a_flat_part_of_what_moves_goes_on_moving() -> None:
    flat = np.full((40, 60), 128, np.uint8)
    velocity = np.full((40, 60, 2), (3.0, 1.0), np.float32)
    np.testing.assert_array_equal(suppress_small_motion(velocity, flat, flat), velocity)
