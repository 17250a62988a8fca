"""Thumbnails that are read ahead: the same as those of a reader, with the same findings, and no process that stays."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import psutil
import pytest

from pipeline.errors import BadInput
from pipeline.video.guard import ahead
from pipeline.video.guard.ahead import NICENESS, ReaderAhead, ThumbnailsAhead
from pipeline.video.guard.reader import GuardedReader
from tests.pipeline.video.making import make_video, picture
from tests.pipeline.video.test_guard import gone, kill, pid_of
from tests.waiting import until


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return make_video(tmp_path / "a.mp4", [picture(i) for i in range(12)])


def test_thumbnails_and_findings_are_those_of_a_reader(clip: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mp4"
    data = bytearray(clip.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = b"\x5a" * 200
    damaged.write_bytes(data)
    for path in (clip, damaged):
        with GuardedReader(path) as usual, ReaderAhead(path) as early:
            expected, found = list(usual.read_thumbnails()), list(early.read_thumbnails())
            np.testing.assert_array_equal(found, expected)
            assert (early.position, early.errors, early.unreadable) == (usual.position, usual.errors, usual.unreadable)


def test_findings_are_told_with_the_thumbnails_not_before(clip: Path) -> None:
    with ReaderAhead(clip) as early:
        until(lambda: not early._waiting.empty())
        before = early.position
        next(iter(early.read_thumbnails()))
        assert before == 0 and early.position != 0


def test_the_decoder_leaves_processors_to_others_and_waits_when_it_is_far_ahead(
    clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ahead, "_MOST_ANSWERS", 1)
    monkeypatch.setattr("pipeline.video.guard.reader._THUMBNAILS", 2)
    with ReaderAhead(clip) as early:
        assert psutil.Process(pid_of(early)).nice() == psutil.Process().nice() + NICENESS
        until(early._waiting.full)
        assert len(list(early.read_thumbnails())) == 12


def test_a_closed_reader_leaves_no_process_and_no_thread(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_MOST_ANSWERS", 1)
    monkeypatch.setattr("pipeline.video.guard.reader._THUMBNAILS", 2)
    early = ReaderAhead(clip)
    child = psutil.Process(pid_of(early))
    until(early._waiting.full)
    early.close()
    assert gone(child)
    until(lambda: not early._thread.is_alive())


def test_only_all_frames_can_be_read(clip: Path) -> None:
    with ReaderAhead(clip) as early, pytest.raises(ValueError, match="all frames"):
        list(early.read_thumbnails(3))


def test_a_file_that_has_changed_is_not_used(clip: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mp4"
    shutil.copy(clip, copy)
    begun = ThumbnailsAhead(copy)
    assert begun.reads(copy) and not begun.reads(clip)
    copy.write_bytes(clip.read_bytes() + b" ")
    assert not begun.reads(copy)
    assert begun.reader() is None


@pytest.mark.parametrize("content", [b"", b"no video"])
def test_a_file_that_is_no_video_is_left_to_whoever_reads_it_next(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "file.mp4"
    file.write_bytes(content)
    begun = ThumbnailsAhead(file)
    assert begun.reader() is None
    with pytest.raises(BadInput):
        GuardedReader(file)
    begun.close()


def test_a_file_that_does_not_exist_is_not_read(tmp_path: Path) -> None:
    begun = ThumbnailsAhead(tmp_path / "none.mp4")
    assert begun.reader() is None and not begun.reads(tmp_path / "none.mp4")


def test_it_is_closed_while_it_opens(clip: Path) -> None:
    begun = ThumbnailsAhead(clip)
    begun.close()
    assert begun.reader() is None


def test_a_decoder_that_dies_is_replaced_but_not_after_the_end(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_MOST_ANSWERS", 1)
    monkeypatch.setattr("pipeline.video.guard.reader._THUMBNAILS", 2)
    with ReaderAhead(clip) as early:
        until(early._waiting.full)
        kill(early)
        assert len(list(early.read_thumbnails())) == 12
    early = ReaderAhead(clip)
    until(early._waiting.full)
    early._closed = True
    kill(early)
    until(lambda: not early._thread.is_alive())
    assert not early._child.alive
