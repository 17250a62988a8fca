"""Contrast of faces: low contrast is raised, inside the face only; good contrast stays."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.perception.face_contrast import FACE_CONTRAST, raise_contrast
from pipeline.perception.faces import FACE, NO_FACES, Faces

SIZE = (160, 120)
BOX = (80.0, 60.0, 48.0, 48.0)


def a_face(strength: float = 1.0) -> Faces:
    return np.array([(BOX, BOX, strength, 3.0, 0.0, 0.0, 0.0)], FACE)


def portrait(depth: int) -> NDArray[np.uint8]:
    """Skin of 120 gray levels with eyes and a mouth that are darker by `depth`, before a wall of 150."""
    picture = np.full((SIZE[1], SIZE[0]), 150, np.uint8)
    cv2.ellipse(picture, (80, 60), (26, 29), 0, 0, 360, 120, -1)
    for x in (70, 90):
        cv2.ellipse(picture, (x, 54), (6, 4), 0, 0, 360, 120 - depth, -1)
    cv2.ellipse(picture, (80, 74), (8, 4), 0, 0, 360, 120 - depth, -1)
    return picture


def test_eyes_of_a_face_of_low_contrast_become_darker_and_its_skin_does_not_change_its_hue() -> None:
    before = cv2.merge([portrait(24), portrait(24) // 2, portrait(24) // 3])
    after = before.copy()
    raise_contrast(after, a_face(), SIZE)
    assert (after[54, 70].astype(int) < before[54, 70].astype(int) - 6).all()
    assert after[60, 80, 0] >= before[60, 80, 0]
    red, green, blue = after[54, 70].astype(float)
    assert red / green == pytest.approx(2, abs=0.1) and red / blue == pytest.approx(3, abs=0.2)


def test_nothing_around_a_face_changes() -> None:
    before = portrait(24)
    after = before.copy()
    raise_contrast(after[..., None], a_face(), SIZE)
    outside = before == 150
    assert np.array_equal(before[outside], after[outside]) and not np.array_equal(before, after)


def test_a_light_wall_beside_the_jaw_of_a_large_face_hardly_changes() -> None:
    """A face of half of the frame, whose jaw is narrower than the detected box: the wall had a light crescent (176)."""
    before = np.full((240, 240), 150, np.uint8)
    cv2.ellipse(before, (120, 120), (52, 66), 0, 0, 360, 120, -1)
    for x in (100, 140):
        cv2.ellipse(before, (x, 106), (12, 8), 0, 0, 360, 96, -1)
    wall = before == 150
    box = (120.0, 120.0, 120.0, 120.0)
    faces = np.array([(box, box, 1.0, 3.0, 0.0, 0.0, 0.0)], FACE)
    after = before.copy()
    raise_contrast(after[..., None], faces, (240, 240))
    assert after[106, 100] < before[106, 100] - 6
    assert int(after[wall].max()) <= 154


def test_a_face_of_good_contrast_stays_as_it_is() -> None:
    before = portrait(110)
    assert before[48:80, 64:96].std() > FACE_CONTRAST.least_contrast
    after = before.copy()
    raise_contrast(after[..., None], a_face(), SIZE)
    assert np.array_equal(before, after)


def test_the_change_grows_with_the_strength_of_the_face() -> None:
    pictures = [portrait(24) for _ in range(3)]
    for picture, strength in zip(pictures, (0.0, 0.5, 1.0), strict=True):
        raise_contrast(picture[..., None], a_face(strength), SIZE)
    none, half, full = (int(picture[54, 70]) for picture in pictures)
    assert none == 96 and full < half < none


def test_a_picture_smaller_than_the_frame_and_a_face_at_its_border() -> None:
    faces = a_face()
    faces["box"][0, :2] = 2.0, 118.0
    small = np.asarray(cv2.resize(portrait(24), (80, 60), interpolation=cv2.INTER_AREA), np.uint8)
    raise_contrast(small[..., None], faces, SIZE)
    large = small.copy()
    raise_contrast(small[..., None], NO_FACES, SIZE)
    assert np.array_equal(small, large)
