"""Interactive propagation: output colours are colours of the key, edits stay local, calls are reproducible."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.frames import Frame
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.propagation import Propagator
from pipeline.methods.analogy.style_images import paint_in_strokes
from pipeline.scenes import scene

pytestmark = pytest.mark.real("opencl")

SIZE, KEY = (96, 72), 3


@pytest.fixture(scope="module")
def shot() -> list[Frame]:
    made = scene("shapes", SIZE, frames=24, fps=24)
    return [made.image(index) for index in range(7)]


@pytest.fixture(scope="module")
def painting(shot: list[Frame]) -> Frame:
    return paint_in_strokes(shot[KEY])


def palette(*pictures: Frame) -> set[bytes]:
    return {colour.tobytes() for picture in pictures for colour in np.unique(picture.reshape(-1, 3), axis=0)}


def test_nearest_neighbours_come_first_and_have_colours_of_the_key(shot: list[Frame], painting: Frame) -> None:
    found = list(Propagator(shot).repaint(KEY, painting))
    assert [index for index, _ in found] == [3, 4, 2, 5, 1]
    np.testing.assert_array_equal(found[0][1], painting)
    assert palette(*(picture for _, picture in found)) <= palette(painting)


def test_paint_follows_the_motion(shot: list[Frame], painting: Frame) -> None:
    found = dict(Propagator(shot).repaint(KEY, painting))
    for index in (1, 5):
        truth = paint_in_strokes(shot[index])
        assert np.abs(found[index].astype(int) - truth).mean() < np.abs(painting.astype(int) - truth).mean()


def test_a_local_edit_repaints_only_pixels_that_show_it(shot: list[Frame], painting: Frame) -> None:
    propagator = Propagator(shot)
    before = dict(propagator.repaint(KEY, painting))
    edit = cv2.circle(painting.copy(), (20, 50), 6, (255, 0, 255), -1)
    after = dict(propagator.repaint(KEY, edit))
    for index in (1, 2, 4, 5):
        changed = (before[index] != after[index]).any(-1)
        assert changed[:, :60].any() and not changed[:, 75:].any()


def test_frames_at_the_ends_have_fewer_neighbours(shot: list[Frame], painting: Frame) -> None:
    assert [index for index, _ in Propagator(shot).repaint(0, painting)] == [0, 1, 2]


def test_equal_calls_give_equal_bytes(shot: list[Frame], painting: Frame) -> None:
    first, second = (dict(Propagator(shot, AnalogyParams(), 7).repaint(KEY, painting)) for _ in range(2))
    for index, picture in first.items():
        np.testing.assert_array_equal(picture, second[index])


def test_a_painting_of_another_size_is_rejected(shot: list[Frame], painting: Frame) -> None:
    with pytest.raises(ValueError, match="keyframe"):
        next(Propagator(shot).repaint(KEY, painting[:-1]))


def test_an_abandoned_call_leaves_no_outdated_result(shot: list[Frame], painting: Frame) -> None:
    first = cv2.circle(painting.copy(), (20, 50), 6, (255, 0, 255), -1)
    second = cv2.circle(first.copy(), (70, 20), 6, (0, 255, 255), -1)
    propagator = Propagator(shot)
    list(propagator.repaint(KEY, painting))
    next(propagator.repaint(KEY, first))  # abandoned before any neighbour was repainted
    found = dict(propagator.repaint(KEY, second))
    assert (found[KEY + 1] == (255, 0, 255)).all(-1).any(), "the edit of the abandoned call is searched, too"


def test_transparent_pixels_show_the_paint_of_another_key(shot: list[Frame], painting: Frame) -> None:
    propagator = Propagator(shot)
    shown = dict(propagator.repaint(KEY, painting))[KEY + 1]
    partial = np.zeros((*painting.shape[:2], 4), np.uint8)
    partial[:10, :10] = 255
    filled = dict(propagator.repaint(KEY + 1, partial))[KEY + 1]
    np.testing.assert_array_equal(filled[10:], shown[10:])
    assert (filled[:10, :10] == 255).all()


def test_cached_memory_is_counted_and_bounded(shot: list[Frame], painting: Frame) -> None:
    propagator = Propagator(shot)
    assert propagator.size_bytes == 0
    list(propagator.repaint(KEY, painting))
    once = propagator.size_bytes
    assert once > 5 * painting.nbytes
    for image in (255 - painting, painting):
        list(propagator.repaint(KEY, image))
    assert propagator.size_bytes == once
