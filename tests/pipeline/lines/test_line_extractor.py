"""Lines in small faces: narrower at the features than on the head's outline, and as strong for faint features."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.methods.abstraction.line_extractor import LineExtractor
from pipeline.methods.abstraction.params import AbstractionParams
from pipeline.methods.abstraction.sizes import sizes_of
from pipeline.perception.face_masks import FaceCrop, small_faces
from pipeline.perception.faces import FACE

SIZE = (320, 240)
EYES = ((148, 113), (172, 113))


def face(contrast: int) -> NDArray[np.uint8]:
    """A light face of 60 px with brows and eyes that are darker by `contrast` gray levels."""
    gray = np.full(SIZE[::-1], 90, np.uint8)
    cv2.ellipse(gray, (160, 120), (33, 44), 0, 0, 360, 170, -1)
    for x, y in EYES:
        cv2.ellipse(gray, (x, y), (5, 2), 0, 0, 360, 170 - contrast, -1)
        cv2.line(gray, (x - 7, y - 8), (x + 7, y - 8), 170 - contrast, 2)
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), 0.8), np.uint8)


def ink(gray: NDArray[np.uint8], crops: list[FaceCrop]) -> NDArray[np.uint8]:
    params = AbstractionParams()
    extractor = LineExtractor(params, sizes_of(params, SIZE))
    neutral = np.full_like(gray, 128)
    return extractor.step(np.stack([gray, neutral, neutral]), np.ones((12, 16), np.float32), None, crops).coverage


@pytest.fixture
def crops() -> list[FaceCrop]:
    box = (160.0, 120.0, 60.0, 60.0)
    known = np.array([(box, box, 1.0, 2.0, 0.0, 0.0, 0.0)], FACE)
    known["box"][0, 2:] = known["detected"][0, 2:] = 44.0  # small relative to 240 lines
    return small_faces(known, SIZE, SIZE)


def test_an_eye_is_apart_from_its_brow(crops: list[FaceCrop]) -> None:
    gray = face(60)
    with_face, without = ink(gray, crops), ink(gray, [])
    for x, y in EYES:
        column = with_face[y - 11 : y + 3, x].astype(int)
        gap = int(column[3:9].min())
        assert column[:5].max() > 150 and column[8:].max() > 100, "brow and eye"
        assert gap < 0.4 * int(without[y - 8 : y - 2, x].min()) or gap < 30


def test_faint_features_are_drawn(crops: list[FaceCrop]) -> None:
    faint, strong = ink(face(34), crops), ink(face(60), crops)
    around = np.s_[100:120, 138:182]
    assert (faint[around] > 100).sum() > 0.4 * (strong[around] > 100).sum() > 0
