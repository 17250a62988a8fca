"""Hands near a face are found by the colour of the face, within arm's reach."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.perception.faces import FACE, Faces
from pipeline.perception.importance import ImportanceParams, ImportanceTracker
from pipeline.perception.skin import skin_beside_faces

SIZE = (256, 192)
SKIN, SHIRT, WALL = (205, 160, 135), (40, 70, 160), (150, 150, 150)
HAND, OTHER_HAND = (90, 130), (170, 120)


def person(skin: tuple[int, int, int] = SKIN, wall: tuple[int, int, int] = WALL) -> Frame:
    """A head, a body and two hands."""
    picture = np.full((SIZE[1], SIZE[0], 3), wall, np.uint8)
    cv2.rectangle(picture, (95, 80), (165, 191), SHIRT, -1)
    cv2.ellipse(picture, (130, 50), (13, 18), 0, 0, 360, skin, -1)
    for hand in (HAND, OTHER_HAND):
        cv2.circle(picture, hand, 8, skin, -1)
    return picture


def a_face(width: float = 24.0, strength: float = 1.0) -> Faces:
    box = (130.0, 50.0, width, width)
    return np.array([(box, box, strength, 2.0, 0.0, 0.0, 0.0)], FACE)


def hands(picture: Frame, faces: Faces, size: tuple[int, int] = SIZE) -> Plane:
    found = skin_beside_faces(picture, faces, size)
    assert found is not None
    return found


def test_both_hands_are_found_and_nothing_else() -> None:
    found = hands(person(), a_face())
    assert min(found[y, x] for x, y in (HAND, OTHER_HAND)) > 0.9
    assert max(found[50, 130], found[150, 130], found[20, 20]) < 0.05, "face, shirt, wall"


def test_strength_of_the_face_is_that_of_its_hands() -> None:
    whole, half = (hands(person(), a_face(strength=strength)) for strength in (1.0, 0.5))
    np.testing.assert_allclose(half, 0.5 * whole, atol=1e-6)


def test_faces_are_given_in_pixels_of_a_larger_frame() -> None:
    faces = a_face()
    faces["box"] *= 4
    large = hands(person(), faces, (4 * SIZE[0], 4 * SIZE[1]))
    np.testing.assert_allclose(large, hands(person(), a_face()))


def test_no_hands_without_colour_of_skin() -> None:
    """A black-and-white film; something in leaves that looks like a face; a face that is too small."""
    for picture, faces in (
        (person((170, 170, 170)), a_face()), (person((90, 150, 60)), a_face()), (person(), a_face(11.0)),
    ):  # fmt: skip
        assert skin_beside_faces(picture, faces, SIZE) is None


def test_a_wall_of_the_same_colour_is_no_hand() -> None:
    found = skin_beside_faces(person(wall=SKIN), a_face(), SIZE)
    assert found is None or found.max() < 0.05


def test_hands_are_important_and_move_with_the_flow() -> None:
    tracker = ImportanceTracker(ImportanceParams(saliency=0, motion=0), SIZE)
    known = {"faces": a_face().view(np.float64).reshape(1, -1), "age": np.array(1)}  # faces of a later frame of a shot
    tracker.restore(tracker.state() | known)
    picture = person()
    importance = [tracker.step(picture, np.zeros((*SIZE[::-1], 2), np.float32))[HAND[1], HAND[0]] for _ in range(3)]
    assert importance == sorted(importance) and importance[-1] > 0.5
    flow = np.zeros((*SIZE[::-1], 2), np.float32)
    flow[100:, :, 1] = 12.0  # both hands go down
    moved = np.roll(picture, 12, axis=0)
    moved[:80] = picture[:80]
    assert tracker.step(moved, flow)[HAND[1] + 12, HAND[0]] > importance[-1] - 0.1


def test_a_restored_tracker_continues_with_the_same_bytes() -> None:
    first = ImportanceTracker(ImportanceParams(), SIZE)
    first.restore(first.state() | {"faces": a_face().view(np.float64).reshape(1, -1), "age": np.array(1)})
    first.step(person())
    second = ImportanceTracker(ImportanceParams(), SIZE)
    second.restore(first.state())
    assert (first.step(person()) == second.step(person())).all()
