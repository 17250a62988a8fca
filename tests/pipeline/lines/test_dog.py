"""Difference of Gaussians and its soft threshold: winnemoeller2006realtime, section 3.3."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Plane
from pipeline.lines.dog import GAUSSIAN_RATIO, dog_response, soft_threshold


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
    assert not soft_threshold(response, at(0.5, (20, 20)), 0.0, 1.0).any()


def test_ink_is_a_tanh_above_the_threshold_and_nothing_below() -> None:
    response = np.linspace(-3, 6, 400, dtype=np.float32)[None]
    ink = soft_threshold(response, at(1 / 3, response.shape), 1.0, 0.8)
    over = np.maximum(response - 1.0, 0)
    np.testing.assert_allclose(ink, 255 * np.tanh(0.8 * over), atol=1.5)
    assert not ink[response <= 1.0].any() and ink.dtype == np.uint8


def test_more_is_drawn_where_importance_is_high() -> None:
    response = np.full((1, 3), 1.0, np.float32)
    importance = np.array([[0.0, 0.5, 1.0]], np.float32)
    assert (np.diff(soft_threshold(response, importance, 1.0, 1.0).astype(int)[0]) > 0).all()
    assert soft_threshold(response, importance, 1.0, 1.0)[0, 0] == 0


def test_a_very_strong_response_is_full_ink() -> None:
    response = np.full((2, 2), 1e6, np.float32)
    assert (soft_threshold(response, at(0, (2, 2)), 1.0, 10.0) == 255).all()


def at(value: float, shape: tuple[int, ...]) -> Plane:
    return np.full(shape, value, np.float32)
