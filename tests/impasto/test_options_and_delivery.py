"""Options are parsed correctly, and outputs are delivered completely or not at all."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

import pytest

from impasto.cli import options
from impasto.cli.input_files import gather
from impasto.delivery import deliver, target
from pipeline.errors import BadInput


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def frames_zip(count: int) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for index in range(count):
            archive.writestr(f"{index:04d}.png", f"frame {index}")
    return data.getvalue()


def test_parameters_are_parsed_as_json_where_possible() -> None:
    keys = options.params_of(["a=0:0.2,48:-0.9", "b=12:3", "c=1:2:3", "d=0:x", "e=[[0, 1]]"])
    assert keys == {"a": [[0, 0.2], [48, -0.9]], "b": [[12, 3]], "c": "1:2:3", "d": "0:x", "e": [[0, 1]]}
    found = options.params_of(["a=1.5", "b=off", "c=true", "d=[1, 2]", 'e="1"', "f=x=y", "g="])
    assert found == {"a": 1.5, "b": "off", "c": True, "d": [1, 2], "e": "1", "f": "x=y", "g": ""}


@pytest.mark.parametrize("pairs", [["nonsense"], ["=1"], ["a=1", "a=2"]])
def test_malformed_parameters_are_refused(pairs: list[str]) -> None:
    with pytest.raises(BadInput) as caught:
        options.params_of(pairs)
    assert caught.value.field == "--param"
    assert caught.value.remedy


def test_the_video_cannot_be_given_as_an_option() -> None:
    with pytest.raises(BadInput, match="first argument"):
        options.inputs_of(["video=a.mp4"])


def test_artefacts_may_have_their_own_output_path() -> None:
    assert options.artefacts_of(["svg", "labels=x.zip"]) == {"svg": None, "labels": Path("x.zip")}


@pytest.mark.parametrize(
    ("name", "kind", "makes"),
    [
        ("a.mp4", "file", "mp4"),
        ("a.WEBM", "file", "webm"),
        ("a.png", "still", "png"),
        ("a.zip", "file", "png"),
        ("new/", "frames", "png"),
        ("new/deep/a.mp4", "file", "mp4"),
    ],
)
def test_the_output_name_determines_the_format(tmp_path: Path, name: str, kind: str, makes: str) -> None:
    found = target(f"{tmp_path}/{name}")
    assert (found.kind, found.format) == (kind, makes)


@pytest.mark.parametrize("name", ["a.avi", "a", "full/", "file/", "file/a.mp4"])
def test_an_impossible_output_path_is_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "diary.txt").write_text("mine")
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput) as caught:
        target(f"{tmp_path}/{name}")
    assert caught.value.field == "--output"
    assert caught.value.remedy


def test_frames_replace_old_frames_without_leftovers(tmp_path: Path) -> None:
    where = target(f"{tmp_path}/out/")
    deliver([frames_zip(5)], where)
    deliver([frames_zip(3)], target(f"{tmp_path}/out/"))
    assert names(tmp_path / "out") == ["0000.png", "0001.png", "0002.png"]
    assert names(tmp_path) == ["out"]


def test_a_still_is_one_frame(tmp_path: Path) -> None:
    deliver([frames_zip(1)], target(f"{tmp_path}/a.png"))
    assert (tmp_path / "a.png").read_text() == "frame 0"
    with pytest.raises(BadInput, match="2 frames"):
        deliver([frames_zip(2)], target(f"{tmp_path}/b.png"))
    assert names(tmp_path) == ["a.png"]


def test_a_failed_delivery_keeps_the_old_result(tmp_path: Path) -> None:
    where = target(f"{tmp_path}/deep/a.mp4")
    deliver([b"old"], where)

    def breaks() -> object:
        yield b"half"
        raise OSError("disk on fire")

    with pytest.raises(OSError, match="on fire"):
        deliver(breaks(), where)  # type: ignore[arg-type]
    assert where.path.read_bytes() == b"old"
    assert names(where.path.parent) == ["a.mp4"]


def test_an_archived_folder_has_the_same_bytes_whatever_its_dates(tmp_path: Path) -> None:
    folder, scratch = tmp_path / "masks", tmp_path / "scratch"
    folder.mkdir()
    scratch.mkdir()
    for name in ("0002.png", "0001.png", ".DS_Store"):
        (folder / name).write_text(name)
    first = gather("--input masks", folder, scratch)
    os.utime(folder / "0001.png", (1e9, 1e9))
    (folder / "0002.png").chmod(0o600)
    again = gather("--input masks", folder, scratch)
    assert first.path != again.path
    assert first.path.read_bytes() == again.path.read_bytes()
    assert zipfile.ZipFile(first.path).namelist() == ["0001.png", "0002.png"]
    assert (first.filename, first.sha256) == ("masks.zip", again.sha256)


def test_missing_inputs_are_named(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    for path in (tmp_path / "none.mp4", empty, Path("/dev/null")):
        with pytest.raises(BadInput) as caught:
            gather("IN", path, tmp_path)
        assert caught.value.field == "IN"
        assert caught.value.remedy
