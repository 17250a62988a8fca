"""Tracked faces: those that a pan brings into view, their state, and the crops of small ones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.perception.face_detector import FaceDetector, Pose
from pipeline.perception.face_masks import face_crops, small_faces
from pipeline.perception.faces import FACE, FaceTracker
from pipeline.scenes import scene

SIZE = (640, 240)
SPEED_PX = 12


@pytest.fixture(scope="module")
def wide() -> NDArray[np.uint8]:
    """A panorama, gray, whose only face is about 40 px wide and 200 px to the right of the first frame's border."""
    made = scene("portrait", (320, 240), frames=1).image(0)
    head = cv2.resize(cv2.cvtColor(made, cv2.COLOR_RGB2GRAY), (160, 120), interpolation=cv2.INTER_AREA)
    out = np.full((SIZE[1], 1400), 110, np.uint8)
    out[60:180, 800:960] = head
    return out


def view(wide: NDArray[np.uint8], index: int) -> NDArray[np.uint8]:
    return np.ascontiguousarray(wide[:, SPEED_PX * index : SPEED_PX * index + SIZE[0]])


def panned(tracker: FaceTracker, wide: NDArray[np.uint8], start: int, stop: int) -> None:
    flow = np.zeros((60, 160, 2), np.float32)
    flow[..., 0] = -SPEED_PX
    for index in range(start, stop):
        tracker.step(view(wide, index), flow if index else None, index)
        tracker.search(view(wide, index), index)


def test_a_face_that_a_pan_brings_into_view_is_found_soon(wide: NDArray[np.uint8]) -> None:
    tracker = FaceTracker(SIZE, 6.0)
    panned(tracker, wide, 0, 14)
    assert not len(tracker.faces), "the face is outside the frame"
    entered = next(i for i in range(14, 60) if 960 - SPEED_PX * i <= SIZE[0])
    panned(tracker, wide, 14, entered + 8)
    assert len(tracker.faces) == 1
    assert tracker.faces["strength"][0] > 0.8, "it counts at once: it was not in view before"


def test_a_restored_tracker_continues_in_a_pan(wide: NDArray[np.uint8]) -> None:
    whole, resumed = FaceTracker(SIZE, 6.0), FaceTracker(SIZE, 6.0)
    panned(whole, wide, 0, 24)
    state = whole.state()
    assert state["unsearched"].any() and "moving" in state
    resumed.restore(state)
    for tracker in (whole, resumed):
        panned(tracker, wide, 24, 45)
    assert len(whole.faces)
    for name, array in whole.state().items():
        np.testing.assert_array_equal(resumed.state()[name], array)


def face(width_px: float) -> NDArray[np.void]:
    box = (100.0, 60.0, width_px, width_px)
    return np.array([(box, box, 1.0, 3.0, 0.0, 0.0, 0.0)], FACE)


def test_small_faces_count_in_full_and_large_ones_not_at_all() -> None:
    size = (200, 120)
    weights = [max((crop.weight.max() for crop in small_faces(face(w), size, size)), default=0) for w in (20, 36, 60)]
    assert weights[0] == 1
    assert 0.3 < weights[1] < 0.7
    assert weights[2] == 0


def test_a_small_face_has_the_same_place_in_a_smaller_picture() -> None:
    (whole,), (half,) = small_faces(face(30), (200, 120), (200, 120)), small_faces(face(30), (200, 120), (100, 60))
    assert half.width_px == whole.width_px / 2
    for side, other in zip(whole.box, half.box, strict=True):
        assert abs(side.start - 2 * other.start) <= 2 and abs(side.stop - 2 * other.stop) <= 2


def test_blending_changes_only_the_face() -> None:
    (crop,) = small_faces(face(20), (200, 120), (200, 120))
    plane = np.full((120, 200), 100, np.uint8)
    crop.blend(plane, np.full(crop.weight.shape, 200, np.uint8))
    assert plane[60, 100] == 200
    outside = plane.copy()
    outside[crop.box] = 100
    assert (outside == 100).all()


def test_a_small_frame_is_searched_in_fewer_larger_pieces(wide: NDArray[np.uint8]) -> None:
    """A face that appears in a still scene is found within one cycle, though most frames search nothing."""
    tracker, searched = FaceTracker((320, 240), 6.0), 0
    face = np.ascontiguousarray(wide[:, 720:1040])
    tracker.step(np.full_like(face, 110), None, 0)
    for age in range(161):
        before = tracker.faces["unchecked"].copy()
        tracker.step(face, np.zeros((24, 32, 2), np.float32), age + 1)
        tracker.search(face, age + 1)
        searched += len(tracker.faces) > len(before)
    assert searched == 1
    assert len(tracker.faces) == 1


def test_a_face_in_a_new_place_is_strong_whichever_search_finds_it(wide: NDArray[np.uint8]) -> None:
    strengths = []
    for first_piece in range(0, 48, 4):  # any piece may be the next one when the face comes into view
        tracker = FaceTracker(SIZE, 6.0)
        tracker.step(view(wide, 0), None, 0)
        for index in range(first_piece + 1, first_piece + 60):
            flow = np.full((60, 160, 2), (-SPEED_PX, 0), np.float32)
            tracker.step(view(wide, index - first_piece), flow, index)
            tracker.search(view(wide, index - first_piece), index)
            if len(tracker.faces):
                strengths.append(tracker.faces["strength"][0])
                break
    assert len(strengths) == 12
    assert min(strengths) > 0.8


def test_the_outline_of_a_head_is_not_among_its_features() -> None:
    box = (80.0, 60.0, 40.0, 40.0)
    crop = small_faces(np.array([(box, box, 1.0, 2.0, 0.0, 0.0, 0.0)], FACE), (320, 240), (320, 240))[0]
    rows, columns = crop.box

    def at(x: float, y: float) -> tuple[int, int]:
        return round(y) - rows.start, round(x) - columns.start

    eye, mouth, ear, hair = at(70, 53), at(80, 70), at(80 + 22, 60), at(80, 60 - 28)
    features = crop.features()
    for place in (eye, mouth):
        assert features[place] > 0.95
    for place in (ear, hair):
        assert features[place] == 0
        assert crop.weight[place] > 0.5


def test_eyes_and_brows_lie_in_the_upper_half_of_a_face_on_both_sides() -> None:
    faces = np.array([((60.0, 50.0, 40.0, 40.0), (60.0, 50.0, 40.0, 40.0), 1.0, 1.0, 0.0, 0.0, 0)], FACE)
    (crop,) = face_crops(faces, (120, 100), (120, 100), np.array([0.5]))
    weight = np.zeros((100, 120), np.float32)
    weight[crop.box] = crop.eyes()
    assert weight[45, 52] == weight[45, 68] == 0.5
    assert weight[58, 60] == weight[30, 60] == weight[60, 52] == 0


@pytest.mark.parametrize(("pose", "least"), [("frontal", 2), ("tilted right", 2), ("left", 5), ("right", 5)])
def test_a_new_face_in_profile_needs_more_hits_than_a_frontal_one(
    pose: Pose, least: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cascades that accept some windows at one place in the middle of the picture, as they do in folds of clothes."""
    picture, candidate = np.zeros((300, 300), np.uint8), np.array([[150.0, 150, 60, 60]])
    for count, found in ((least - 1, 0), (least, 1)):

        def hits(_self: object, gray: NDArray[np.uint8], *_: object, count: int = count) -> NDArray[np.int32]:
            (height, width), side = gray.shape, 60
            return np.array([((width - side) // 2, (height - side) // 2, side, side)] * count, np.int32)

        monkeypatch.setattr(FaceDetector, "_hits", hits)
        tracker = FaceTracker((300, 300), 6.0)
        tracker._add_new(picture, candidate, pose)
        monkeypatch.undo()
        assert len(tracker.faces) == found, f"{count} hits"
