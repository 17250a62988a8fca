"""`impasto report SOURCE RESULT`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from impasto.cli.app import run


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("report")
    made = {}
    for name, size, frames in (
        ("whole", "96x64", 8),
        ("short", "96x64", 5),
        ("small", "48x32", 8),
        ("tall", "64x96", 8),
    ):
        made[name] = folder / f"{name}.mp4"
        assert run(["scene", "shapes", "-o", str(made[name]), "--size", size, "--frames", str(frames), "--quiet"]) == 0
    return made


def report(capsys: pytest.CaptureFixture[str], *words: str | Path) -> dict[str, object]:
    capsys.readouterr()
    assert run(["report", *map(str, words), "--json"]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_a_video_equals_itself(clips: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    found = report(capsys, clips["whole"], clips["whole"])
    assert (found["frames"], found["pairs"], found["flicker"], found["detail"]) == (8, 7, 1.0, 1.0)


def test_the_report_samples_pairs_and_accepts_other_lengths_and_sizes(
    clips: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert report(capsys, clips["whole"], clips["whole"], "--pairs", "3")["pairs"] == 3
    capsys.readouterr()
    assert run(["report", str(clips["whole"]), str(clips["short"]), "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["frames"] == 5 and "the first 5 are compared" in printed.err
    enlarged = report(capsys, clips["whole"], clips["small"])
    assert isinstance(enlarged["detail"], float) and enlarged["detail"] < 0.95


def test_the_table_explains_each_measure(clips: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["report", str(clips["whole"]), str(clips["short"])]) == 0
    printed = capsys.readouterr()
    assert "flicker" in printed.out and "1 = that of the source" in printed.out
    assert "the first 5 are compared" in printed.err


def test_the_report_refuses_other_shapes_and_missing_files(
    clips: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    for words, text in (
        ([clips["whole"], clips["tall"]], "their shapes differ"),
        ([clips["whole"], "no.mp4"], "not found"),
    ):
        assert run(["report", *map(str, words), "--json"]) == 2
        assert text in json.loads(capsys.readouterr().out)["error"]["message"]
