"""Decoders stay open between tasks, up to a limit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import UnreadableMedia
from pipeline.frames import Frame
from workers.blobs.disk import DiskBlobs
from workers.execution.arrays import read_arrays, write_arrays
from workers.execution.decoders import Decoders, frame_at
from workers.execution.stage_timer import StageTimer


@pytest.fixture
def blobs(home: Path, tiny_clip: Path) -> DiskBlobs:
    made = DiskBlobs(home)
    for name in ("a", "b", "c"):
        made.put(name, tiny_clip)
    return made


class ShortReader:
    """A reader that lists ten frames and ends after five."""

    frames = 10

    def read(self, start: int, stop: int) -> Iterator[Frame]:
        yield from (np.zeros((16, 16, 3), np.uint8) for _ in range(start, min(stop, 5)))


def test_a_frame_that_is_not_there_is_refused() -> None:
    reader: Any = ShortReader()
    assert frame_at(reader, 4).shape == (16, 16, 3)
    with pytest.raises(UnreadableMedia) as caught:
        frame_at(reader, 9)
    assert caught.value.field == "frame" and caught.value.remedy


def test_a_reader_is_reused_for_the_next_contiguous_range(blobs: DiskBlobs) -> None:
    decoders = Decoders(blobs)
    with decoders.reader("a") as first:
        assert len(list(first.read(0, 5))) == 5
        with decoders.reader("a", 10) as second:
            assert second is not first
            assert len(list(second.read(10, 12))) == 2
    with decoders.reader("a", 5) as again:
        assert again is first
    with decoders.reader("a", 12) as other:
        assert other is second
    decoders.close()


def test_the_oldest_readers_are_closed_and_failed_readers_are_discarded(blobs: DiskBlobs) -> None:
    decoders = Decoders(blobs, idle=1)
    with decoders.reader("a") as first:
        pass
    with decoders.reader("b"):
        pass
    with decoders.reader("a") as again:
        assert again is not first
    with pytest.raises(RuntimeError), decoders.reader("a") as failed:
        raise RuntimeError
    with decoders.reader("a") as fresh:
        assert fresh is not failed
    decoders.close()


def test_an_abandoned_read_returns_its_reader(blobs: DiskBlobs) -> None:
    decoders = Decoders(blobs)

    def frames() -> object:
        with decoders.reader("a") as reader:
            yield reader
            yield from reader.read()

    walk = frames()
    reader = next(walk)  # type: ignore[call-overload]
    next(walk)  # type: ignore[call-overload]
    walk.close()  # type: ignore[attr-defined]
    with decoders.reader("a") as again:
        assert again is reader
    decoders.close()


def test_reading_a_missing_blob_raises(blobs: DiskBlobs) -> None:
    with pytest.raises(KeyError), Decoders(blobs).reader("none"):
        pass


def test_arrays_are_loaded_and_pickles_are_refused(tmp_path: Path) -> None:
    arrays = {"labels": np.arange(60, dtype=np.int32).reshape(6, 10), "flow": np.ones((3, 4, 2), np.float32)}
    for name in ("one", "two"):
        with (tmp_path / name).open("wb") as stream:
            write_arrays(stream, arrays)
    data = (tmp_path / "one").read_bytes()
    assert data == (tmp_path / "two").read_bytes()
    found = read_arrays(data)
    assert found.keys() == arrays.keys()
    assert all(np.array_equal(found[k], arrays[k]) and found[k].dtype == arrays[k].dtype for k in arrays)
    with (tmp_path / "bad").open("wb") as stream, pytest.raises(ValueError, match="Object arrays"):
        write_arrays(stream, {"x": np.array([object()])})


def test_method_time_excludes_decoding_and_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 1.0, 3.0, 10.0])
    monkeypatch.setattr("workers.execution.stage_timer.time.perf_counter", lambda: next(now))
    stages = StageTimer()
    with stages.method(), stages.waiting("decode"):
        pass
    assert stages.seconds() == {"decode": 2.0, "method": 8.0}


def test_method_time_excludes_waiting_for_a_stage_of_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 1.0, 3.0, 10.0])
    monkeypatch.setattr("workers.execution.stage_timer.time.perf_counter", lambda: next(now))
    stages = StageTimer()
    with stages.method(), stages.blocked():
        pass
    assert stages.seconds() == {"method": 8.0}
