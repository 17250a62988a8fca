"""A face search in slices finds the faces of one complete search."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from cv2.data import haarcascades
from numpy.typing import NDArray

from pipeline.scenes import scene
from pipeline.segmentation.face_detector import SLICES, FaceDetector, join, slices

FACTOR = 1.2


@pytest.fixture(scope="module")
def picture() -> NDArray[np.uint8]:
    made = scene("portrait", (320, 240), frames=1).image(0)
    return np.asarray(cv2.cvtColor(made, cv2.COLOR_RGB2GRAY), np.uint8)


def test_slices_cover_every_size_once() -> None:
    parts = slices(FACTOR, 24, 240)
    assert len(parts) == SLICES
    assert parts[0][0] == 24
    assert all(low <= high < later for (low, high), (later, _) in pairwise(parts))
    cost = [
        sum(1 / s**2 for s in (24, 29, 35, 41, 50, 60, 72, 86, 103, 124, 149, 178, 214) if a <= s <= b)
        for a, b in parts
    ]
    assert max(cost) < 0.4 * sum(cost)


@pytest.mark.parametrize("size", [(20, 19), (30, 30), (200, 20)])
def test_with_few_sizes_some_slices_are_empty(size: tuple[int, int], picture: NDArray[np.uint8]) -> None:
    parts = slices(FACTOR, *size)
    assert len(parts) == SLICES
    whole = FaceDetector().hits(picture, FACTOR, *size) if size[0] <= size[1] else np.empty((0, 4), np.int32)
    found = [FaceDetector().hits(picture, FACTOR, low, high) for low, high in parts]
    assert sorted(map(tuple, np.vstack(found))) == sorted(map(tuple, whole))


def test_slices_find_the_same_faces_as_one_opencv_search(picture: NDArray[np.uint8]) -> None:
    cascade = cv2.CascadeClassifier(haarcascades + "haarcascade_frontalface_alt2.xml")
    at_once = cascade.detectMultiScale(picture, FACTOR, 3, minSize=(24, 24), maxSize=(240, 240))
    finder = FaceDetector()
    hits = np.vstack([finder.hits(picture, FACTOR, low, high) for low, high in slices(FACTOR, 24, 240)])
    boxes = join(hits)
    assert len(boxes) == len(at_once) > 0
    corners = sorted((x - w / 2, y - h / 2, w, h) for x, y, w, h in boxes)
    np.testing.assert_allclose(corners, sorted(map(tuple, at_once)), atol=1)


def test_no_hits_give_no_faces() -> None:
    assert join(np.empty((0, 4), np.int32)).shape == (0, 4)
