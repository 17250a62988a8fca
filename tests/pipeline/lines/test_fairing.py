"""Fair curves."""

from __future__ import annotations

import numpy as np

from pipeline.lines.fairing import fair


def faired(places: np.ndarray) -> np.ndarray:
    return fair(places.astype(np.float32), np.array([0, len(places)], np.int32))


def noisy(places: np.ndarray) -> np.ndarray:
    return places + np.random.default_rng(1).normal(0, 0.25, places.shape)


def test_a_straight_line_becomes_straight() -> None:
    x = np.arange(150.0)
    out = faired(noisy(np.column_stack([x, 20 + 0.3 * x])))
    off = (out[:, 1] - 20 - 0.3 * out[:, 0]) / np.hypot(1, 0.3)
    assert np.abs(off).max() < 0.12 and np.std(off) < 0.05


def test_a_corner_stays_sharp() -> None:
    sides = np.concatenate([[(x, 0.0) for x in range(60)], [(60.0, y) for y in range(60)]])
    out = faired(noisy(sides))
    assert np.hypot(*(out[60] - (60, 0))) < 1.2
    assert np.abs(out[20:54, 1]).max() < 0.2 and np.abs(out[68:100, 0] - 60).max() < 0.2


def test_a_circle_stays_round() -> None:
    angles = np.arange(0, 2 * np.pi, 1 / 30)
    out = faired(np.column_stack([30 * np.cos(angles), 30 * np.sin(angles)]))
    radii = np.hypot(*out.T)
    assert np.abs(radii - 30).max() < 0.5
    assert np.abs(radii[30:-30] - 29.9).max() < 0.15, "far from the ends"


def test_short_curves_and_none_are_returned() -> None:
    two = np.array([[1.0, 2.0], [2.0, 2.5]])
    np.testing.assert_allclose(faired(two), two)
    assert fair(np.empty((0, 2), np.float32), np.zeros(1, np.int32)).shape == (0, 2)
