"""Frames from the cache are those of the decoder, damaged ones are read again, and memory is bounded."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.frames import Frame
from workers.execution.frame_cache import FrameCache


class Counting:
    """A reader of ten frames that notes which it has decoded. Frame 4 is damaged."""

    def __init__(self) -> None:
        self.errors: list[str] = []
        self.unreadable: list[int] = []
        self.decoded: list[int] = []

    def read(self, start: int = 0, stop: int | None = None) -> Iterator[Frame]:
        for number in range(start, 10 if stop is None else min(stop, 10)):
            self.decoded.append(number)
            if number == 4:
                self.unreadable.append(number)
            yield np.full((2, 3, 3), number, np.uint8)


def numbers(frames: Iterator[Frame]) -> list[int]:
    return [int(frame[0, 0, 0]) for frame in frames]


def test_frames_are_decoded_once() -> None:
    cache, reader = FrameCache(), Counting()
    assert numbers(cache.read("a", reader, 5, 8)) == [5, 6, 7]
    assert numbers(cache.read("a", reader, 3, 20)) == [3, 4, 5, 6, 7, 8, 9]
    assert reader.decoded == [5, 6, 7, 3, 4, 8, 9]
    assert (cache.first_missing("a", 3), cache.first_missing("a", 5), cache.first_missing("b", 5)) == (4, 10, 5)
    assert numbers(cache.read("a", reader, 0)) == [*range(10)]
    assert numbers(cache.read("a", reader, 7, 7)) == []


def test_a_damaged_frame_is_read_by_every_reader() -> None:
    cache = FrameCache()
    for _ in range(2):
        reader = Counting()
        assert numbers(cache.read("a", reader, 2, 7)) == [2, 3, 4, 5, 6]
        assert reader.unreadable == [4]


def test_frames_belong_to_the_reader() -> None:
    cache, reader = FrameCache(), Counting()
    for _ in range(3):
        for frame in cache.read("a", reader, 0, 3):
            assert frame.max() < 3
            frame[:] = 200


def test_the_least_recently_used_frames_are_dropped() -> None:
    cache, reader = FrameCache(most_bytes=3 * 18), Counting()
    assert numbers(cache.read("a", reader, 0, 4)) == [0, 1, 2, 3]
    assert numbers(cache.read("a", reader, 1, 2)) == [1]
    assert numbers(cache.read("a", reader, 9)) == [9]
    assert [cache.first_missing("a", number) > number for number in range(4)] == [False, True, False, True]
    assert numbers(FrameCache(most_bytes=17).read("a", Counting(), 0)) == [*range(10)]
