"""Face detection: the pieces of a search cover it, at about equal cost; candidates, confirmation and poses."""

from __future__ import annotations

from collections import defaultdict

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.perception.face_detector import POSES, FaceDetector, Piece, Pose, pieces, pose_pieces
from pipeline.perception.faces import FaceTracker
from pipeline.scenes import scene

SIZE = (320, 240)


@pytest.fixture(scope="module")
def picture() -> NDArray[np.uint8]:
    made = scene("portrait", SIZE, frames=1).image(0)
    return np.asarray(cv2.cvtColor(made, cv2.COLOR_RGB2GRAY), np.uint8)


@pytest.fixture(scope="module")
def face(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The face of `picture`, as one search of the whole picture finds it."""
    finder = FaceDetector()
    found = [
        box
        for piece in pose_pieces(SIZE, "frontal", 24)
        for candidate in finder.candidates(picture, piece)
        if (box := finder.confirm(picture, candidate)) is not None
    ]
    assert found
    return found[0]


@pytest.mark.parametrize("count", [1, 40, 200])
def test_bands_of_pieces_cover_every_position_of_every_size(count: int) -> None:
    tops: dict[tuple[Pose, int], set[int]] = defaultdict(set)
    for pose, least, most, top, bottom in pieces(SIZE, 24, count):
        for side in (
            side for side in (24, 29, 35, 41, 50, 60, 72, 86, 103, 124, 149, 178, 214) if least <= side <= most
        ):
            tops[pose, side] |= set(range(top, bottom - side + 1))
    for pose in POSES:
        for side in (60, 103, 214):
            assert tops[pose, side] == set(range(SIZE[1] - side + 1)), (pose, side)
    assert tops["frontal", 24] == set(range(SIZE[1] - 23))


def test_pieces_are_as_many_as_wanted_and_no_piece_is_much_larger() -> None:
    found = pieces((640, 480), 24, 100)
    assert 100 <= len(found) <= 130
    cost = [(piece.bottom - piece.top) / piece.least**2 for piece in found]
    assert max(cost) < 5 * np.mean(cost)


def test_a_frame_smaller_than_the_window_has_no_pieces() -> None:
    assert pieces((20, 20), 24, 10) == []


def test_pieces_find_the_same_face_as_a_search_of_the_whole_frame(
    picture: NDArray[np.uint8], face: NDArray[np.float64]
) -> None:
    finder = FaceDetector()
    found = [
        box
        for piece in pieces(SIZE, 24, 60)
        if piece.pose == "frontal"
        for candidate in finder.candidates(picture, piece)
        if (box := finder.confirm(picture, candidate)) is not None
    ]
    assert any(np.linalg.norm(box[:2] - face[:2]) < 0.1 * face[2] for box in found)


def test_a_flat_picture_has_no_candidates_and_confirms_none(face: NDArray[np.float64]) -> None:
    flat = np.full(SIZE[::-1], 128, np.uint8)
    assert not len(FaceDetector().candidates(flat, Piece("frontal", 24, 240, 0, 240)))
    assert FaceDetector().confirm(flat, face) is None


def test_a_tilted_face_is_found_upright_in_the_turned_picture(
    picture: NDArray[np.uint8], face: NDArray[np.float64]
) -> None:
    centre = (float(face[0]), float(face[1]))
    turned = np.asarray(cv2.warpAffine(picture, cv2.getRotationMatrix2D(centre, 25, 1), SIZE), np.uint8)
    box = FaceDetector().confirm(turned, face, "tilted left")
    assert box is not None
    assert np.linalg.norm(box[:2] - face[:2]) < 0.2 * face[2]


def test_the_second_cascade_agrees_on_a_face_and_knows_no_profiles(
    picture: NDArray[np.uint8], face: NDArray[np.float64]
) -> None:
    finder, flat = FaceDetector(), np.full(SIZE[::-1], 120, np.uint8)
    assert finder.agrees(picture, face, "frontal")
    assert not finder.agrees(flat, face, "frontal")
    assert not finder.agrees(flat, face, "tilted left")
    assert finder.agrees(flat, face, "left")


@pytest.mark.parametrize("seed", [14, 20, 22, 32])
def test_texture_that_looks_like_a_face_to_one_cascade_only_is_not_tracked(seed: int) -> None:
    """The first cascade finds a face in each of these pictures of smooth noise, the second one finds none there."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(180, 240)).astype(np.float32), (0, 0), 3)
    picture = np.clip(128 + noise / noise.std() * 45, 0, 255).astype(np.uint8)
    finder = FaceDetector()
    candidates = [box for piece in pose_pieces((240, 180), "frontal", 36) for box in finder.candidates(picture, piece)]
    assert any(finder.confirm(picture, box) is not None for box in candidates)
    tracker = FaceTracker((240, 180), 6.0)
    tracker.step(picture, None, 0)
    assert not len(tracker.faces)
