"""Shots: detection, reading, and faults named by layer and frame."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from impasto.cli.input_files import gather
from pipeline.errors import BadMedia
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.shot_archive import check_pictures, read_shot
from pipeline.video.shot_files import ShotFiles, is_shot, pictures_of
from tests.pipeline.methods.shots import SIZE, pictures, png, scene_files

Files = dict[str, bytes]


def zipped(path: Path, files: Files, root: str = "") -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(root + name, data)
    return path


@pytest.mark.parametrize("root", ["", "my shot/"])
def test_a_shot_is_a_video_of_its_frames_for_any_method(tmp_path: Path, root: str) -> None:
    path = zipped(tmp_path / "a.zip", dict(scene_files()), root)
    info = probe(path)
    assert (info.kind, info.width, info.height, info.frames) == ("archive", *SIZE, 4)
    with VideoReader(path) as reader:
        for frame, truth in zip(reader.read(), pictures(), strict=True):
            np.testing.assert_array_equal(frame, truth)
    assert "frames/0000.png" in ShotFiles(path)


@pytest.mark.parametrize("missing", ["0001", "0002"])
@pytest.mark.parametrize("everywhere", [True, False], ids=["in every pass", "in the frames"])
@pytest.mark.parametrize("root", ["", "my shot/"])
def test_missing_frames_of_a_shot_are_held_on_request(
    missing: str, everywhere: bool, root: str, tmp_path: Path
) -> None:
    folders = ("frames/",) if not everywhere else ("",)
    files = {
        name: data for name, data in scene_files().items()
        if not (missing in name and "keyframes" not in name and "painted" not in name and name.startswith(folders))
    }  # fmt: skip
    with pytest.raises(BadMedia):
        probe(zipped(tmp_path / "gap.zip", files, root))
    path = zipped(tmp_path / "held.zip", files | {"sequence.json": b'{"missing": "hold"}'}, root)
    info = probe(path)
    assert info.frames == 4 and any(missing.lstrip("0") in note for note in info.notes)
    before = int(missing) - 1
    with VideoReader(path) as reader:
        frames = list(reader.read())
    np.testing.assert_array_equal(frames[before + 1], frames[before])
    shot = ShotFiles(path)
    layout = read_shot(shot)
    assert layout.frames == 4
    check_pictures(shot, layout, SIZE)
    whole = layout.whole.passes["frames"]
    assert shot[whole[before + 1]] == shot[whole[before]]
    for layer in layout.layers:
        for name in ("masks", "normals"):
            if layer.passes.get(name) and everywhere:
                assert shot[layer.passes[name][before + 1]] == shot[layer.passes[name][before]]


def test_plain_numbered_images_are_not_a_shot() -> None:
    assert not is_shot(["clip/frames/1.png", "clip/frames/2.png"]) and not is_shot(["1.png"])
    assert pictures_of(["b/10.png", "b/2.png"]) == ["b/10.png", "b/2.png"]


def test_frame_numbers_may_start_anywhere() -> None:
    names = [f"frames/{n}.png" for n in (101, 102, 103)] + ["keyframes/key_102.png"]
    layout = read_shot(dict.fromkeys(names, b""))
    assert layout.frames == 3 and list(layout.whole.passes["keyframes"]) == [1]


def edited(change: Callable[[Files], None]) -> Files:
    files = {
        **scene_files(),
        **{f"layers/front/masks/{n:04d}.png": png(np.zeros(SIZE[::-1], np.uint8)) for n in range(4)},
    }
    change(files)
    return files


def lose(files: Files) -> None:
    del files["layers/front/masks/0002.png"]


def stray(files: Files) -> None:
    files["layers/front/keyframes/0009.png"] = png(pictures()[0])


def double(files: Files) -> None:
    files["layers/front/masks/m_002.png"] = files["layers/front/masks/0002.png"]


def unnumbered(files: Files) -> None:
    files["layers/front/masks/first.png"] = files["layers/front/masks/0002.png"]


def small(files: Files) -> None:
    files["layers/front/masks/0002.png"] = png(np.zeros((20, 30), np.uint8))


def nowhere(files: Files) -> None:
    files["layers/front/notes/0002.png"] = png(pictures()[0])


def unlisted(files: Files) -> None:
    files["layers/extra/masks/0000.png"] = png(pictures()[0])


def shapeless(files: Files) -> None:
    files["shot.json"] = json.dumps({"layers": [{"name": "front", "ids": ["x"]}]}).encode()


def broken(files: Files) -> None:
    files["shot.json"] = b"{"


def empty(files: Files) -> None:
    manifest = json.loads(files["shot.json"])
    manifest["layers"].append({"name": "ghost"})
    files["shot.json"] = json.dumps(manifest).encode()


def renamed(files: Files) -> None:
    files["layers/front/masks/0002.png"] = b"RIFF0000WAVE"


def lonely(files: Files) -> None:
    files["layers/front/painted/0002.png"] = files["layers/front/masks/0002.png"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lose, ["front", "frame 2", "masks"]),
        (stray, ["front", "keyframes/0009.png", "0 to 3"]),
        (double, ["front", "0002.png", "have the number 2"]),
        (unnumbered, ["front", "first.png"]),
        (small, ["masks/0002.png", "30x20", "96x72"]),
        (nowhere, ["notes/0002.png"]),
        (unlisted, ["extra", "shot.json"]),
        (shapeless, ["layers[0].ids[0]"]),
        (broken, ["not JSON"]),
        (empty, ["ghost", "layers[2]"]),
        (renamed, ["masks/0002.png"]),
        (lonely, ["front", "painted/0002.png", "keyframe"]),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)  # fmt: skip
def test_a_fault_is_named_with_layer_and_frame(change: Callable[[Files], None], words: list[str]) -> None:
    files = edited(change)
    with pytest.raises(BadMedia) as caught:
        check_pictures(files, read_shot(files), SIZE)
    found = f"{caught.value} {caught.value.remedy}"
    assert [word for word in words if word not in found] == []
    assert caught.value.remedy


def test_an_invalid_shot_is_rejected_at_upload(tmp_path: Path) -> None:
    with pytest.raises(BadMedia, match="front"):
        probe(zipped(tmp_path / "a.zip", edited(lose)))


def test_a_folder_is_read_like_its_archive(tmp_path: Path) -> None:
    folder = tmp_path / "shot"
    for name, data in scene_files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    with VideoReader(folder) as reader:
        np.testing.assert_array_equal(next(reader.read(2, 3)), pictures()[2])
    sent = gather("IN", folder, _made(tmp_path / "scratch"))
    assert set(ShotFiles(sent.path)) == set(scene_files()) and probe(sent.path).frames == 4


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder
