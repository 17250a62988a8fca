"""`impasto inspect`: what a sequence holds, what methods use, and passes as inputs."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

import impasto
from impasto.cli.app import run
from pipeline.formats.exr import EXR
from pipeline.video.media import Limits
from tests.pipeline.methods.test_given_motion import FRAMES, SIZE, blender, files, shot


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "shot"
    made.mkdir()
    for name, data in files(blender).items():
        (made / name).write_bytes(data)
    return made


def report(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    assert run(["inspect", *arguments, "--json"]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)
    return found


def test_passes_and_their_use_are_listed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = report(capsys, str(folder))
    passes = found["passes"]
    assert isinstance(passes, dict) and passes["kinds"] == ["motion"] and passes["layer"] == "Combined"
    assert passes["vectors"]["factors"] == [-1, -1, -1] and passes["vectors"]["unit"] == "px"
    assert found["numbers"] == [[1001, 1004, 1]] and (found["width"], found["height"]) == SIZE
    assert all(passes["vectors"]["message"] in told for told in found["methods"].values())  # type: ignore[attr-defined]
    assert run(["inspect", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "1001 to 1004" in text and "replace optical flow" in text and "patches: Motion: see above." in text


def test_vectors_can_be_switched_off_or_stated(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    off = report(capsys, str(folder), "--vectors", "off")["passes"]
    assert isinstance(off, dict) and "vectors" not in off and off["kinds"] == []
    stated = report(capsys, str(folder), "--vectors", "nuke")["passes"]
    assert isinstance(stated, dict) and stated["vectors"]["stated"] == "nuke"


def test_motion_is_extracted_with_the_numbers_of_the_frames(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "motion.zip"
    assert run(["inspect", str(folder), "--extract", f"motion={path}"]) == 0
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == [f"{1001 + index}.exr" for index in range(FRAMES)]
        planes = EXR.planes(archive.read("1002.exr"), Limits()).planes
    np.testing.assert_allclose(planes["forward.u"], shot(1).velocity_next[..., 0], atol=1e-5)
    np.testing.assert_allclose(planes["backward.v"], -shot(1).velocity_previous[..., 1], atol=1e-5)


def test_a_video_or_an_unknown_pass_is_refused(
    folder: Path, tiny_clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for source, what, why in (
        (tiny_clip, "ids", "no render passes"), (folder, "ids", "have no ids"), (folder, "shadow", "Unknown pass"),
        (folder, "matte:Cube", "no Cryptomatte"), (folder, "matte", "Unknown pass"),
    ):  # fmt: skip
        assert run(["inspect", str(source), "--extract", f"{what}={tmp_path / 'x.zip'}"]) != 0
        assert why in capsys.readouterr().err
        assert not list(tmp_path.glob("*x.zip*")), "nothing is left of a pass that is not there"


def test_the_library_uses_the_vectors_as_the_command_does(folder: Path, tmp_path: Path) -> None:
    frames = list(impasto.render("abstraction", folder))
    assert run(["render", str(folder), "-o", f"{tmp_path}/out/", "--quiet", "--home", str(tmp_path / "home")]) == 0
    written = [cv2.imread(str(path))[..., ::-1] for path in sorted((tmp_path / "out").iterdir())]
    assert len(frames) == len(written) == FRAMES
    assert all((ours == theirs).all() for ours, theirs in zip(frames, written, strict=True))


@pytest.mark.real("media")
def test_a_matte_of_a_cryptomatte_equals_the_index_pass(media: Path, tmp_path: Path) -> None:
    """Edges differ: an index pass is not antialiased, a matte is."""
    source, cube, ids = media / "blender" / "b45", tmp_path / "cube.zip", tmp_path / "ids.zip"
    assert run(["inspect", str(source), "--extract", f"matte:Cube={cube}", "--extract", f"ids={ids}"]) == 0
    for name in ("1001.png", "1004.png"):
        matte, index = (
            cv2.imdecode(np.frombuffer(zipfile.ZipFile(path).read(name), np.uint8), cv2.IMREAD_UNCHANGED)
            for path in (cube, ids)
        )
        apart = np.abs(matte / 65535 - (index == 1))
        print(name, apart.mean())
        assert apart.mean() < 0.01 and (matte > 0).mean() > 0.05


@pytest.mark.real("media")
@pytest.mark.parametrize(("name", "kinds", "way"), [
    ("b45", ["motion", "normals", "ids", "depth", "mattes"], "both"),
    ("b5", ["motion", "normals", "ids", "depth", "mattes"], "both"),
    ("eev", ["motion", "normals", "depth", "mattes"], "both"),
    ("one", ["motion"], "next"),
    ("vl2", ["motion", "normals", "ids", "depth", "mattes"], "both"),
])  # fmt: skip
def test_what_blender_wrote_is_found(
    media: Path, capsys: pytest.CaptureFixture[str], name: str, kinds: list[str], way: str
) -> None:
    passes = report(capsys, str(media / "blender" / name))["passes"]
    assert isinstance(passes, dict) and passes["kinds"] == kinds
    vectors = passes["vectors"]
    assert (vectors["way"], vectors["unit"]) == (way, "px") and vectors["error"] < vectors["still"] / 3
    assert name != "eev" or vectors["error"] < 1.5
    assert passes["layer"] == ("" if name == "one" else "ViewLayer.Combined")
