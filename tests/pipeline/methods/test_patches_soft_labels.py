"""Mattes of labels: borders move to the colour edges of the full-size frame, and mattes sum to 1."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame, Labels
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.soft_labels import SoftLabels
from pipeline.methods.patches.tracking import uncertainty_of

SIZE = (640, 360)
GRID = Grid.of(SIZE)


def disc(radius: float = 80.0) -> tuple[Frame, np.ndarray]:
    """A red disc on a blue ground, anti-aliased, and its exact coverage."""
    y, x = np.indices(SIZE[::-1])
    cover = np.clip(radius - np.hypot(x - 300.3, y - 180.6) + 0.5, 0, 1)
    noise = np.random.default_rng(3).normal(0, 3, (*SIZE[::-1], 3))
    picture = np.array([40, 60, 160]) + cover[..., None] * np.array([160, -20, -120]) + noise
    return np.clip(picture, 0, 255).astype(np.uint8), cover


def coarse(cover: np.ndarray, shift: int) -> Labels:
    """The disc's label map at the working size, wrong by `shift` working px."""
    small = cv2.resize(cover, GRID.size, interpolation=cv2.INTER_AREA) > 0.5
    return np.where(np.roll(small, shift, axis=1), 2, 1).astype(np.int32)


@pytest.mark.parametrize("shift", [0, 1, 2])
def test_a_border_goes_to_the_edge_of_the_frame(shift: int) -> None:
    frame, cover = disc()
    soft = SoftLabels(coarse(cover, shift), frame, GRID)
    alpha = soft.alpha(2, (slice(0, SIZE[1]), slice(0, SIZE[0])))
    before = np.abs(GRID.enlarge((soft.labels == 2).astype(np.float32)) - cover).sum()
    assert np.abs(alpha - cover).sum() < 0.45 * before
    assert ((soft.full() == 2) != (cover > 0.5)).mean() < 0.004


def test_the_transition_is_narrow() -> None:
    """10 to 90 % within three px, where an enlarged label map takes more than twice the width of a working pixel."""
    frame, cover = disc()
    row = SoftLabels(coarse(cover, 0), frame, GRID).alpha(2, (slice(0, SIZE[1]), slice(0, SIZE[0])))[180]
    between = (row[200:300] > 0.1) & (row[200:300] < 0.9)
    assert between.sum() <= 3


def test_two_labels_sum_to_one_and_far_from_borders_they_are_exact() -> None:
    frame, cover = disc()
    soft = SoftLabels(coarse(cover, 1), frame, GRID)
    box = (slice(0, SIZE[1]), slice(0, SIZE[0]))
    one, other = soft.alpha(1, box), soft.alpha(2, box)
    assert np.abs(one + other - 1).max() < 1e-3
    assert (one[:40] == 1).all() and (other[170:190, 290:310] == 1).all()


def test_uncertainty_is_the_doubt_of_the_random_walk() -> None:
    labels = np.array([[1, 1, 2, 2], [1, 1, 2, 0]], np.int32)
    probability = np.array([[1, 1, 0.75, 0.5], [1, 0.5, 0.75, 0]], np.float32)
    assert uncertainty_of(labels, probability) == {1: 0.25, 2: 0.667}


def test_a_frame_of_one_label() -> None:
    frame, cover = disc()
    soft = SoftLabels(np.full_like(coarse(cover, 0), 1), frame, GRID)
    assert (soft.alpha(1, soft.box(1)) == 1).all() and (soft.full() == 1).all()
    assert soft.alpha(7, soft.box(7)).size == 0
