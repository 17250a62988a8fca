"""Canny edges with thresholds that depend on importance."""

from __future__ import annotations

import cv2
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from pipeline.perception.face_masks import FaceCrop
from pipeline.regions.edges import edges

HIGH, LOW_RATIO, FLOOR = 90.0, 0.4, 0.2


def texture(seed: int, shape: tuple[int, int] = (48, 64)) -> NDArray[np.uint8]:
    """Soft blobs in even gray levels: half of an even gradient is exact."""
    noise = np.random.default_rng(seed).integers(0, 128, shape).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5), np.uint8) * 2


def colourless(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Planes L, a, b of gray levels."""
    return np.stack([gray, *np.full((2, *gray.shape), 128, np.uint8)])


def constant(gray: NDArray[np.uint8], importance: float) -> NDArray[np.uint8]:
    return edges(colourless(gray), np.full(gray.shape, importance, np.float32), HIGH, (), LOW_RATIO, FLOOR)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.8, 0.3]))
def test_constant_importance_equals_opencv_canny(seed: int, importance: float) -> None:
    gray = texture(seed)
    high = HIGH / (importance + FLOOR)
    np.testing.assert_array_equal(constant(gray, importance), cv2.Canny(gray, high * LOW_RATIO, high))


def test_thresholds_are_inverse_to_importance() -> None:
    """A step of s levels has a Sobel gradient of 4 s: it is an edge from 4 s (I + 0.2) = 90 on."""
    for importance in (0.0, 0.3, 0.8, 1.0):
        least = HIGH / (importance + FLOOR) / 4
        assert not constant(step(int(least - 1)), importance).any()
        assert constant(step(int(least + 2)), importance).any()


def test_colours_of_equal_lightness_have_an_edge_but_not_inside_a_small_face() -> None:
    lab = np.full((3, 48, 64), 128, np.uint8)
    lab[1, :, 32:] = 158  # a*: 30 units
    importance = np.full((48, 64), 0.8, np.float32)
    face = FaceCrop((slice(10, 40), slice(20, 50)), np.ones((30, 30), np.float32), (35.0, 25.0, 20.0, 20.0))
    found, with_face = edges(lab, importance, HIGH), edges(lab, importance, HIGH, [face])
    assert not edges(colourless(lab[0]), importance, HIGH).any()
    assert (found[4:-4].sum(axis=1) == 255).all()
    assert not with_face[11:39].any() and (with_face[2:8].sum(axis=1) == 255).all()


def test_chroma_that_does_not_change_leaves_the_edges_of_the_lightness() -> None:
    lab = np.stack([texture(1), np.full((48, 64), 90, np.uint8), np.full((48, 64), 140, np.uint8)])
    importance = np.full((48, 64), 0.8, np.float32)
    np.testing.assert_array_equal(edges(lab, importance, HIGH), edges(colourless(lab[0]), importance, HIGH))


@pytest.mark.parametrize("seed", range(4))
def test_higher_importance_keeps_all_edges(seed: int) -> None:
    less, more = constant(texture(seed), 0.3), constant(texture(seed), 0.8)
    assert (more[less > 0] > 0).all() and (more > 0).sum() > (less > 0).sum()


def test_thresholds_vary_by_pixel_with_a_map_of_any_size() -> None:
    gray = np.tile(step(30), (2, 1))
    importance = np.repeat(np.array([[1.0], [0.0]], np.float32), 2, axis=0)
    for plane in (importance, np.asarray(cv2.resize(importance, gray.shape[::-1]), np.float32)):
        found = edges(colourless(gray), plane, HIGH)
        assert found[:30].any() and not found[-30:].any()


def test_weak_edges_are_kept_if_connected_to_strong_ones() -> None:
    """Hysteresis across the varying threshold: an edge goes on into what is less important, but not beyond `low`."""
    gray = step(30)
    importance = np.tile(np.linspace(1, 0, gray.shape[0], dtype=np.float32)[:, None], (1, gray.shape[1]))
    last = int(np.flatnonzero(edges(colourless(gray), importance, HIGH).any(axis=1)).max())
    without = int(np.flatnonzero(edges(colourless(gray), importance, HIGH, low_ratio=1.0).any(axis=1)).max())
    assert without < last
    assert importance[last, 0] + FLOOR == pytest.approx(HIGH * LOW_RATIO / 120, abs=0.05)


def test_a_flat_picture_has_no_edges_and_the_result_is_0_or_255() -> None:
    assert not constant(np.full((48, 64), 77, np.uint8), 1.0).any()
    assert set(np.unique(constant(texture(1), 0.8))) == {0, 255}


def step(levels: int) -> NDArray[np.uint8]:
    """Dark left, brighter right."""
    gray = np.full((48, 64), 100, np.uint8)
    gray[:, 32:] += np.uint8(levels)
    return gray
