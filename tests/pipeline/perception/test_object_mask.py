"""An object is found by a click on it and by a box around it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Frame, Mask
from pipeline.perception.object_mask import Box, clicked_pixels, object_mask, without_object

SIZE = (240, 160)


def two_discs() -> tuple[Frame, Mask]:
    """Two noisy orange discs on a noisy green field, and the pixels of the left one."""
    draw = np.random.default_rng(1)
    frame = np.full((SIZE[1], SIZE[0], 3), (90, 140, 70), np.uint8)
    disc = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    cv2.circle(disc, (70, 80), 32, 1, -1)
    frame[disc > 0] = (220, 150, 40)
    cv2.circle(frame, (180, 80), 24, (220, 150, 40), -1)
    return np.clip(frame + draw.normal(0, 8, frame.shape), 0, 255).astype(np.uint8), disc > 0


def overlap(found: NDArray[np.bool_], wanted: Mask) -> float:
    return float((found & wanted).sum() / (found | wanted).sum())


@pytest.mark.parametrize("box", [(70 / 240, 0.5, 70 / 240, 0.5), (0.45, 0.85, 0.1, 0.15)], ids=["click", "box"])
def test_the_object_is_found_and_no_other_of_its_colour(box: Box) -> None:
    frame, disc = two_discs()
    found = object_mask(frame, box)
    assert overlap(found, disc) > 0.95
    np.testing.assert_array_equal(found, object_mask(frame, box))


def test_a_box_of_the_whole_frame_finds_what_is_unlike_its_edge() -> None:
    frame, disc = two_discs()
    found = object_mask(frame, (0, 0, 1, 1))
    assert found[disc].mean() > 0.95 and found[80, 180] and found[:10].mean() < 0.05


@pytest.mark.parametrize("at", [(0, 0), (1, 1), (0.999, 0.5)])
def test_a_click_at_the_frames_edge_and_on_a_plain_frame_is_answered(at: tuple[float, float]) -> None:
    plain = np.full((32, 48, 3), 120, np.uint8)
    assert object_mask(plain, (*at, *at)).shape == (32, 48)


def test_a_box_around_an_object_that_is_coloured_like_its_surroundings_finds_something() -> None:
    draw = np.random.default_rng(2)
    frame = draw.integers(90, 160, (160, 240, 3)).astype(np.uint8)
    cv2.circle(frame, (120, 80), 40, (120, 128, 132), -1)
    found = object_mask(frame, (0.3, 0.2, 0.7, 0.8))
    assert found[70:90, 110:130].all() and not found[:, :60].any()


def test_a_click_does_not_take_surroundings_along_whose_colours_are_near() -> None:
    frame = np.full((180, 320, 3), (236, 232, 228), np.uint8)
    frame[:90] = (244, 244, 246)
    cup = np.zeros(frame.shape[:2], np.uint8)
    cv2.rectangle(cup, (200, 80), (240, 150), 1, -1)
    frame[cup > 0] = (30, 120, 210)
    cv2.ellipse(frame, (220, 80), (20, 6), 0, 0, 360, (15, 60, 130), -1)
    frame = np.clip(frame + np.random.default_rng(4).normal(0, 3, frame.shape), 0, 255).astype(np.uint8)
    assert overlap(object_mask(frame, (0.68, 0.66, 0.68, 0.66)), cup > 0) > 0.85


def test_a_second_click_adds_and_one_that_takes_away_leaves_the_rest() -> None:
    frame, disc = two_discs()
    left, right = (70 / 240, 0.5, 70 / 240, 0.5), (180 / 240, 0.5, 180 / 240, 0.5)
    both = object_mask(frame, right, None, object_mask(frame, left))
    other = cv2.circle(np.zeros(disc.shape, np.uint8), (180, 80), 24, 1, -1) > 0
    assert overlap(both, disc | other) > 0.95
    assert overlap(without_object(frame, both, right, clicked_pixels(frame, left)), disc) > 0.9
    box = (130 / 240, 0.2, 235 / 240, 0.8)
    assert overlap(without_object(frame, both, box, clicked_pixels(frame, left)), disc) > 0.9
