"""Threads of a task on machines with many processors: order, bound, failures, and the bytes of a method with them."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from pipeline.kernels import ahead as threads
from pipeline.kernels.ahead import ahead
from tests.pipeline.methods.frames import painted
from tests.pipeline.methods.patch_scenes import paint, truth


def processors(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "usable_processors", lambda: count)


@pytest.mark.parametrize("count", [2, 16])
def test_items_are_made_in_order(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    processors(count, monkeypatch)
    with ahead(lambda item: item * item, range(40), 3, "test") as made:
        assert list(made) == [item * item for item in range(40)]


def test_few_items_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    processors(16, monkeypatch)
    read = []

    def items() -> Iterator[int]:
        for item in range(20):
            read.append(item)
            yield item

    with ahead(lambda item: item, items(), 2, "test", most=3) as made:
        for item in made:
            assert len(read) <= item + 4


def test_a_failure_reaches_the_caller_and_ends_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    processors(16, monkeypatch)

    def fails(item: int) -> int:
        if item == 2:
            raise ValueError("frame 2")
        return item

    before = threading.active_count()
    with pytest.raises(ValueError, match="frame 2"), ahead(fails, range(9), 2, "test") as made:
        list(made)
    assert threading.active_count() == before


@pytest.mark.parametrize("params", [{}, {"frames_per_painting": 2}, {"temporal": "off"}], ids=str)
def test_threads_do_not_change_the_bytes_of_patches(params: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for count in (2, 16):
        processors(count, monkeypatch)
        results.append(painted(paint([shot.image for shot in truth(26)], **params)))
    np.testing.assert_array_equal(*results)
