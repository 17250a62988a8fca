"""Mattes of labels: borders move to the colour edges of the full-size frame, and adjacent mattes sum to 1."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame, Labels
from pipeline.regions.mattes import LabelMattes

SIZE = (640, 360)
LABEL_SIZE = (320, 180)


def disc(radius: float = 80.0) -> tuple[Frame, np.ndarray]:
    """A red disc on a blue background, anti-aliased, and its exact coverage."""
    y, x = np.indices(SIZE[::-1])
    cover = np.clip(radius - np.hypot(x - 300.3, y - 180.6) + 0.5, 0, 1)
    noise = np.random.default_rng(3).normal(0, 3, (*SIZE[::-1], 3))
    picture = np.array([40, 60, 160]) + cover[..., None] * np.array([160, -20, -120]) + noise
    return np.clip(picture, 0, 255).astype(np.uint8), cover


def coarse(cover: np.ndarray, shift: int) -> Labels:
    """The disc's label map at the reduced size, displaced by `shift` px of the label map."""
    small = cv2.resize(cover, LABEL_SIZE, interpolation=cv2.INTER_AREA) > 0.5
    return np.where(np.roll(small, shift, axis=1), 2, 1).astype(np.int32)


@pytest.mark.parametrize("shift", [0, 1, 2])
def test_a_border_moves_to_the_colour_edge_of_the_frame(shift: int) -> None:
    frame, cover = disc()
    mattes = LabelMattes(coarse(cover, shift), frame)
    alpha = mattes.alpha(2, (slice(0, SIZE[1]), slice(0, SIZE[0])))
    enlarged = cv2.resize((mattes.labels == 2).astype(np.float32), SIZE, interpolation=cv2.INTER_LINEAR)
    before = np.abs(enlarged - cover).sum()
    assert np.abs(alpha - cover).sum() < 0.45 * before
    assert ((mattes.full() == 2) != (cover > 0.5)).mean() < 0.004


def test_the_transition_at_a_border_is_narrow() -> None:
    """The matte rises from 10 to 90 % within three px; in an enlarged label map it takes more than four."""
    frame, cover = disc()
    row = LabelMattes(coarse(cover, 0), frame).alpha(2, (slice(0, SIZE[1]), slice(0, SIZE[0])))[180]
    between = (row[200:300] > 0.1) & (row[200:300] < 0.9)
    assert between.sum() <= 3


def test_two_mattes_sum_to_one_and_are_exact_far_from_borders() -> None:
    frame, cover = disc()
    mattes = LabelMattes(coarse(cover, 1), frame)
    box = (slice(0, SIZE[1]), slice(0, SIZE[0]))
    one, other = mattes.alpha(1, box), mattes.alpha(2, box)
    assert np.abs(one + other - 1).max() < 1e-3
    assert (one[:40] == 1).all() and (other[170:190, 290:310] == 1).all()


def test_a_frame_with_a_single_label_has_a_full_matte() -> None:
    frame, cover = disc()
    mattes = LabelMattes(np.full_like(coarse(cover, 0), 1), frame)
    assert (mattes.alpha(1, mattes.box(1)) == 1).all() and (mattes.full() == 1).all()
    assert mattes.alpha(7, mattes.box(7)).size == 0
