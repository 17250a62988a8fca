"""`impasto scene` writes exactly the frames of the scene."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from impasto.cli.app import run
from pipeline.scenes import scene, scenes

SMALL = ["--size", "64x48", "--frames", "3", "--quiet"]


def test_every_scene_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["scene", "--json"]) == 0
    assert [each["name"] for each in json.loads(capsys.readouterr().out)] == list(scenes())


@pytest.mark.parametrize("suffix", ["mp4", "webm"])
def test_a_scene_is_written_to_a_video_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"shapes.{suffix}"
    assert run(["scene", "shapes", "-o", str(path), *SMALL]) == 0
    with av.open(str(path)) as clip:
        frames = [frame.to_ndarray(format="rgb24") for frame in clip.decode(video=0)]
    drawn = scene("shapes", (64, 48), 3)
    assert len(frames) == 3
    assert all(np.abs(frames[i].astype(int) - drawn.image(i)).mean() < 12 for i in range(3))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_every_pass_of_a_scene_is_written_losslessly(tmp_path: Path) -> None:
    for _ in range(2):  # the second replaces the first
        assert run(["scene", "harbour", "-o", f"{tmp_path}/harbour/", *SMALL]) == 0
    folder, drawn = tmp_path / "harbour", scene("harbour", (64, 48), 3).frame(1)
    image = cv2.imread(str(folder / "image" / "0001.png"))
    assert np.array_equal(image[..., ::-1], drawn.image)
    assert np.array_equal(cv2.imread(str(folder / "ids" / "0001.png"), cv2.IMREAD_UNCHANGED), drawn.ids)
    assert np.array_equal(np.load(folder / "velocity_next" / "0001.npy"), drawn.velocity_next)
    assert np.array_equal(np.load(folder / "normals" / "0001.npy"), drawn.normals)
    hidden = cv2.imread(str(folder / "occluded_previous" / "0001.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(hidden == 255, drawn.occluded_previous)
    written = json.loads((folder / "scene.json").read_text())
    assert (written["width"], written["height"], written["frames"]) == (64, 48, 3)
    assert [p.name for p in tmp_path.iterdir()] == ["harbour"]


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["oil", "-o", "x.mp4"], "harbour"),
        (["harbour"], "-o harbour.mp4"),
        (["harbour", "-o", "x.avi"], ".mp4"),
        (["harbour", "-o", "x.mp4", "--size", "64"], "640x360"),
        (["harbour", "-o", "x.mp4", "--size", "8x8"], "16"),
        (["harbour", "-o", "x.mp4", "--fps", "nan"], "1000"),
        (["harbour", "-o", "full/"], "new folder"),
    ],
)
def test_bad_scene_arguments_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], hint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "diary.txt").write_text("mine")
    assert run(["scene", *words]) == 2
    assert hint in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["full"]
