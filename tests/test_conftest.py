"""The shared fixtures and the marker keep their promises."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import av
import pytest

from tests.conftest import PARTS, ROOT, TINY_FRAMES, TINY_HEIGHT, TINY_WIDTH, _require
from tests.parallel import IN_CHROMIUM, LONGEST, arrange, how_it_ended


def test_the_tiny_clip_has_pictures_and_sound(tiny_clip: Path) -> None:
    with av.open(str(tiny_clip)) as clip:
        stream = clip.streams.video[0]
        assert (stream.width, stream.height) == (TINY_WIDTH, TINY_HEIGHT)
        assert sum(1 for _ in clip.decode(stream)) == TINY_FRAMES
    with av.open(str(tiny_clip)) as clip:
        assert clip.duration == pytest.approx(2_000_000, rel=0.05)
        assert sum(f.samples for f in clip.decode(audio=0)) >= 2 * 44100 - 2048


def _lack(monkeypatch: pytest.MonkeyPatch, part: str, require: str) -> None:
    monkeypatch.setitem(PARTS, part, lambda: "it is not here")
    monkeypatch.setenv("IMPASTO_REQUIRE_REAL", require)


def test_a_missing_part_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    _lack(monkeypatch, "chromium", "0")
    with pytest.raises(pytest.skip.Exception, match="it is not here"):
        _require("chromium")


def test_a_missing_part_fails_where_real_is_required(monkeypatch: pytest.MonkeyPatch) -> None:
    _lack(monkeypatch, "chromium", "1")
    with pytest.raises(pytest.fail.Exception, match="required"):
        _require("chromium")


def test_missing_media_are_skipped_even_where_real_is_required(monkeypatch: pytest.MonkeyPatch) -> None:
    _lack(monkeypatch, "media", "1")
    with pytest.raises(pytest.skip.Exception):
        _require("media")


def test_the_slowest_files_exist_and_run_first(request: pytest.FixtureRequest) -> None:
    assert [file for file in LONGEST if not (ROOT / file).is_file()] == []
    items = list(request.session.items)
    arrange(items)
    places = [LONGEST.index(file) for item in items if (file := item.nodeid.partition("::")[0]) in LONGEST]
    assert places == sorted(places)


def test_every_file_that_uses_the_browser_is_in_a_group() -> None:
    pages = (ROOT / "tests" / "e2e").glob("test_*.py")
    shared = [path for path in pages if re.search(r"\b(browser: Browser|\w+: Watched)\b", path.read_text())]
    alone = {path.relative_to(ROOT).as_posix() for path in shared if "mark.serial" not in path.read_text()}
    assert alone == {file for group in IN_CHROMIUM for file in group}


def test_the_log_tells_how_a_test_process_ended() -> None:
    ended = how_it_ended(subprocess.Popen(["sh", "-c", "kill -USR1 $$"]))
    assert re.match(r"exit status -10 .*; \d+ MiB of memory .* \d+ processes", ended)


def test_an_unknown_part_is_an_error() -> None:
    with pytest.raises(pytest.fail.Exception, match="unknown real part"):
        _require("teapot")
