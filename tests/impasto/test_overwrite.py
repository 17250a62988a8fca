"""No command replaces a file of its user unless `--overwrite` is given."""

from __future__ import annotations

from pathlib import Path

import pytest

from impasto.cli.app import run
from impasto.live.plain_sinks import open_sink
from impasto.live.sources import open_source
from pipeline.errors import BadInput

MINE = b"mine"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.mp4"
    path.write_bytes(MINE)
    return path


def test_a_scene_does_not_replace_a_file(mine: Path) -> None:
    words = ["scene", "harbour", "-o", str(mine), "--frames", "2", "--size", "64x48", "--quiet"]
    assert (run(words), mine.read_bytes()) == (2, MINE)
    assert run([*words, "--overwrite"]) == 0
    assert mine.read_bytes() != MINE


def test_a_live_stream_does_not_replace_a_file(mine: Path, tiny_clip: Path) -> None:
    source = open_source(str(tiny_clip), 1, None, None, "auto")
    with pytest.raises(BadInput) as error:
        open_sink(str(mine), source, 20, overwrite=False)
    assert "--overwrite" in error.value.remedy
    source.close()
    words = ["live", "--input", str(tiny_clip), "--output", str(mine), "--server", "http://127.0.0.1:9"]
    assert (run(words), mine.read_bytes()) == (2, MINE)


def test_an_extracted_pass_does_not_replace_a_file(mine: Path, tiny_clip: Path) -> None:
    words = ["inspect", str(tiny_clip), "--extract", f"ids={mine}"]
    assert (run(words), mine.read_bytes()) == (2, MINE)
