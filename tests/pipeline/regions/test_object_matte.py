"""A clicked object is followed through the frames before and after the click, up to a cut."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.frames import Frame, Plane
from pipeline.regions.object_matte import (
    BACK_FRAMES,
    Memory,
    NoMemory,
    ObjectMark,
    ObjectMatte,
    follow_marks,
)

WIDTH, HEIGHT, FRAMES = 160, 112, 14


def _discs(number: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Pixels of a disc that moves to the right by 3 px a frame, and of one that rests."""
    moving, resting = (np.zeros((HEIGHT, WIDTH), np.uint8) for _ in range(2))
    cv2.circle(moving, (40 + 3 * number, 40), 20, 1, -1)
    cv2.circle(resting, (40, 90), 14, 1, -1)
    return moving, resting


@pytest.fixture(scope="module")
def shot() -> list[Frame]:
    """Noisy discs, blue and orange, on a textured field."""
    draw = np.random.default_rng(3)
    field = cv2.GaussianBlur(draw.integers(60, 200, (HEIGHT, WIDTH)).astype(np.uint8), (0, 0), 2)
    weave = cv2.GaussianBlur(draw.normal(0, 60, (HEIGHT, WIDTH + 3 * FRAMES)), (0, 0), 1.5)
    frames = []
    for number in range(FRAMES):
        frame = np.dstack([field // 2, field, field // 3])
        for disc, colour in zip(_discs(number), ((40, 70, 220), (230, 140, 30)), strict=True):
            shade = weave[:, 3 * (FRAMES - number) :][:, :WIDTH] if colour[2] > 200 else weave[:, :WIDTH]
            frame[disc > 0] = np.clip(np.array(colour) + shade[disc > 0][:, None], 0, 255)
        frames.append(frame.astype(np.uint8))
    return frames


def _follow(frames: list[Frame], *marks: ObjectMark) -> dict[int, Plane]:
    def read(start: int, stop: int) -> Iterator[Frame]:
        assert stop - start <= BACK_FRAMES or (start, stop) == (0, len(frames)), "frames are read in pieces"
        return iter(frames[start:stop])

    found = [(one.frame, one.alpha()) for one in follow_marks(marks, (0, len(frames)), read)]
    assert sorted(number for number, _ in found) == list(range(len(frames))), "every frame once"
    assert all(plane.shape == (HEIGHT, WIDTH) and plane.min() >= 0 and plane.max() <= 1 for _, plane in found)
    return dict(found)


def _at(x: float, y: float) -> tuple[float, float, float, float]:
    return (x / WIDTH, y / HEIGHT, x / WIDTH, y / HEIGHT)


def _overlap(matte: Plane, disc: NDArray[np.uint8]) -> float:
    found, wanted = matte > 0.5, disc > 0
    return float((found & wanted).sum() / (found | wanted).sum())


def test_an_object_is_followed_forwards_and_backwards_from_its_click(shot: list[Frame]) -> None:
    mattes = _follow(shot, ObjectMark(10, _at(70, 40)))
    assert min(_overlap(mattes[number], _discs(number)[0]) for number in mattes) > 0.8
    again = _follow(shot, ObjectMark(10, _at(70, 40)))
    assert all((mattes[number] == again[number]).all() for number in mattes)


def test_a_second_click_adds_and_an_erasing_click_takes_away_from_its_frame_on(shot: list[Frame]) -> None:
    first, second = ObjectMark(2, _at(46, 40)), ObjectMark(6, _at(40, 90))
    mattes = _follow(shot, first, second, ObjectMark(9, _at(67, 40), erase=True))
    both = [tuple(_overlap(mattes[n] * _half(top), _discs(n)[1 - top]) > 0.8 for top in (1, 0)) for n in range(FRAMES)]
    assert both[:6] == [(True, False)] * 6 and both[6:9] == [(True, True)] * 3 and both[9:] == [(False, True)] * 5


def _half(top: int) -> Plane:
    """1 in the upper half of the frame, where the moving disc is, or in the lower one."""
    rows = np.arange(HEIGHT)[:, None] < 66
    return np.broadcast_to(rows == bool(top), (HEIGHT, WIDTH)).astype(np.float32)


def test_a_cut_ends_the_object_and_frames_without_a_mark_have_none(shot: list[Frame]) -> None:
    other = [255 - frame[::-1] for frame in shot[:4]]
    mattes = _follow([*other, *shot], ObjectMark(8, _at(52, 40)))
    assert all(mattes[number].max() == 0 for number in range(4)), "before the cut"
    assert min(_overlap(mattes[4 + number], _discs(number)[0]) for number in range(FRAMES)) > 0.8
    ended = _follow([*shot[:5], *other], ObjectMark(2, _at(46, 40)))
    assert ended[4].max() > 0.9 and all(ended[number].max() == 0 for number in range(5, 9))


def test_a_painted_stroke_is_exactly_what_is_added_or_erased_and_is_followed(shot: list[Frame]) -> None:
    clicked = _follow(shot, ObjectMark(2, _at(46, 40)))
    wide = ((20 / WIDTH, 90 / HEIGHT, 12 / WIDTH), (60 / WIDTH, 90 / HEIGHT, 12 / WIDTH))
    painted = _follow(shot, ObjectMark(2, _at(46, 40)), ObjectMark(5, stroke=wide))
    assert all((painted[number] == clicked[number]).all() for number in range(5))
    assert painted[5][86:95, 30:50].min() > 0.9 and painted[5][70:80].max() < 0.1
    assert painted[13][86:94, 32:48].mean() > 0.9, "it rests with what it was painted on"
    tall = ((64 / WIDTH, 15 / HEIGHT, 20 / WIDTH), (64 / WIDTH, 65 / HEIGHT, 20 / WIDTH))
    erased = _follow(shot, ObjectMark(2, _at(46, 40)), ObjectMark(8, stroke=tall, erase=True))
    assert erased[8][35:45, 58:70].max() < 0.1 and erased[8][35:45, 46:52].min() > 0.9
    assert erased[11][35:45, 68:78].mean() < 0.3, "the hole moves with the disc"


class _Kept(dict[object, object]):
    """Keeps everything, and counts how often something was found."""

    made = 0

    def peek(self, key: object) -> Any:
        return super().get(key)

    def get(self, key: object, make: Callable[[], Any]) -> Any:  # type: ignore[override]
        if key not in self:
            self.made += 1
            self[key] = make()
        return self[key]


def test_the_clicked_frame_comes_first_and_nothing_is_found_twice(shot: list[Frame]) -> None:
    def read(start: int, stop: int) -> Iterator[Frame]:
        return iter(shot[start:stop])

    def follow(memory: Memory, *marks: ObjectMark) -> list[ObjectMatte]:
        return list(follow_marks(marks, (0, FRAMES), read, marks[-1].frame, memory))

    first, second = ObjectMark(2, _at(46, 40)), ObjectMark(9, _at(40, 90))
    memory = _Kept()
    assert [one.frame for one in follow(memory, first)][:4] == [2, 1, 0, 3]
    made = memory.made
    found = follow(memory, first, second)
    assert [one.frame for one in found][:3] == [9, 2, 1]
    assert memory.made - made == FRAMES - 9, "the masks from the new click on"
    alone = {one.frame: one.alpha() for one in follow(NoMemory(), first, second)}
    assert all(np.array_equal(one.alpha(), alone[one.frame]) for one in found), "memory changes nothing"
