"""Difference of Gaussians: winnemoeller2006realtime, section 3.3."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.lines.dog import GAUSSIAN_RATIO, dog_response


def test_the_response_is_the_difference_of_two_gaussians() -> None:
    """The tolerance is a few tenths of a level, since implementations truncate the Gaussians differently."""
    gray = np.random.default_rng(0).uniform(0, 255, (40, 50)).astype(np.float32)
    narrow, wide = (cv2.GaussianBlur(gray, (31, 31), sigma) for sigma in (1.5, 1.5 * GAUSSIAN_RATIO))
    wanted = 0.98 * wide - narrow
    assert np.abs(dog_response(gray, 1.5, 0.98) - wanted).max() < 0.5 < 0.05 * np.abs(wanted).max()


def test_the_response_is_positive_on_the_dark_side_of_an_edge() -> None:
    gray = np.full((30, 60), 200, np.float32)
    gray[:, :30] = 60
    response = dog_response(gray, 1.5, 0.99)
    assert response[15, 28] > 5 and response[15, 31] < -5
    gray = np.full((30, 60), 200, np.float32)
    gray[:, 30] = 60
    assert dog_response(gray, 1.0, 0.99)[15].argmax() == 30


@pytest.mark.parametrize("level", [0, 100, 255])
def test_the_response_of_a_flat_area_is_below_any_threshold(level: int) -> None:
    response = dog_response(np.full((20, 20), level, np.float32), 1.2, 0.99)
    np.testing.assert_allclose(response, -0.01 * level, atol=1e-3)
