"""Frame numbers of sequences, keys and masks: names, gaps, patterns, choice of one sequence."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import BadParameter, NotASequence, UnreadableMedia
from pipeline.video.numbered import NumberedImages, by_frame
from pipeline.video.numbering import (
    described,
    frame_numbers,
    frames_of,
    is_pattern,
    numbers_of_runs,
    runs_of_numbers,
    sequence_numbers,
)
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.sequence_options import SequenceOptions, options_of
from pipeline.video.stills import encode_png


@pytest.mark.parametrize(
    "names",
    [
        ("00000.png", "00006.png"),
        ("00000-1234567.png", "00006-1234567.png"),  # Stable Diffusion: number and seed
        ("00000-3.png", "00006-7.png"),
        ("00000-1234567.png", "00006-7654321.png"),
        ("key_00000_.png", "key_00006_.png"),  # ComfyUI
        ("_0000_Layer 1.png", "_0006_Layer 2.png"),  # Photoshop
        ("_0000_Background.png", "_0006_Layer 2 copy 3.png"),
        ("00000.png", "00006 (1).png"),  # a copy
        ("00000.png", "00006 - Copy.png"),
        ("00000_v2.png", "00006_v2.png"),
        ("shot_v02.0.png", "shot_v02.6.png"),
        ("00000.JPG", "00006.png"),
        ("f_+000.png", "f_+006.png"),
        ("scene 3 take 2 0000.png", "scene 3 take 2 0006.png"),
    ],
)
def test_names_as_programs_write_them(names: tuple[str, str]) -> None:
    assert list(frame_numbers(names).values()) == [0, 6]


@pytest.mark.parametrize(
    "names",
    [
        ("a1_b2.png",),
        ("1001-7.png", "1002-3.png"),
        ("IMG_20261128_101112.png", "IMG_20261129_090000.png"),
        ("Screenshot 2026-11-28 at 5.40.12.png", "Screenshot 2026-11-29 at 6.41.13.png"),
        ("0006.png", "0006 (1).png"),
        ("6.png", "006.png"),
        ("shot_v01.1001.png", "shot_v02.1001.png"),
    ],
)
def test_unclear_names_are_refused_with_the_reason(names: tuple[str, ...]) -> None:
    with pytest.raises(NotASequence) as caught:
        frame_numbers(names)
    assert caught.value.value and caught.value.remedy


def test_signs_and_separators() -> None:
    assert frame_numbers(["f_-003.png", "f_+000.png", "f_+001.png"]) == {
        "f_-003.png": -3, "f_+000.png": 0, "f_+001.png": 1,
    }  # fmt: skip
    assert list(frame_numbers(["a.-2.exr", "a.-1.exr", "a.0.exr"]).values()) == [-2, -1, 0]
    assert list(frame_numbers(["shot-0001.png", "shot-0002.png"]).values()) == [1, 2]
    assert list(frame_numbers(["-0002.png", "-0001.png", "0000.png"]).values()) == [-2, -1, 0]


def test_gaps_are_refused_held_or_skipped_and_always_named() -> None:
    numbers = [1001, 1002, 1005]
    with pytest.raises(NotASequence, match="Frames 1003 to 1004 are missing"):
        frames_of(numbers, "fail")
    held, skipped = frames_of(numbers, "hold"), frames_of(numbers, "skip")
    assert (held.numbers, held.shown) == ((1001, 1002, 1003, 1004, 1005), (0, 1, 1, 1, 2))
    assert (skipped.numbers, skipped.shown) == ((1001, 1002, 1005), (0, 1, 2))
    assert all("1003 to 1004 are missing" in " ".join(found.notes) for found in (held, skipped))
    ends = frames_of([2, 3], "hold", (1, 4))
    assert (ends.numbers, ends.shown) == ((1, 2, 3, 4), (0, 0, 1, 1))
    assert frames_of([1, 3, 5], "fail").notes == ("The numbers go in steps of 2: no frame counts as missing.",)
    with pytest.raises(NotASequence, match="too long"):
        frames_of([0, 1, 10**9], "hold")


def test_one_sequence_is_expected() -> None:
    two = ["beauty.1.png", "beauty.2.png", "depth.1.png", "depth.2.png"]
    with pytest.raises(NotASequence, match=r"beauty\.####\.png \(2 images\), depth\.####\.png \(2 images\)"):
        sequence_numbers(two)
    assert [number for number, _ in sequence_numbers(two, "depth.%d.png")] == [1, 2]
    for other in ("folder.jpg", "b/beauty.3.png", "beauty.3.jpg"):
        with pytest.raises(NotASequence, match="2 sequences"):
            sequence_numbers(["beauty.1.png", "beauty.2.png", other])


@pytest.mark.parametrize(
    ("pattern", "numbers"),
    [("b.%04d.png", [1, 2, 30]), ("b.####.png", [1, 2, 30]), ("b.[1-20].png", [1, 2]), ("B.%d.PNG", [1, 2, 30]),
     ("b.[2-30].png", [2, 30])],
)  # fmt: skip
def test_patterns_and_ranges(pattern: str, numbers: list[int]) -> None:
    names = ["b.0001.png", "b.0002.png", "b.0030.png", "c.0001.png", "b.0001 (1).png"]
    assert is_pattern(pattern) and [number for number, _ in sequence_numbers(names, pattern)] == numbers


def test_numbers_are_stored_as_runs() -> None:
    numbers = [-3, -2, -1, 5, 7, 9, 20]
    assert numbers_of_runs(runs_of_numbers(numbers)) == numbers
    assert described(runs_of_numbers(numbers)) == "-3 to -1, 5 to 9 in steps of 2, 20"


# -- files


def frame(index: int) -> bytes:
    picture = np.full((32, 48, 3), 40, np.uint8)
    picture[8:24, 4 * index : 4 * index + 4] = 230
    return encode_png(picture)


def marks(path: Path, **options: object) -> list[int]:
    with VideoReader(path, sequence=options_of(options)) as reader:
        return [int(np.flatnonzero(shown[16, :, 0] > 150)[0]) // 4 for shown in reader.read()]


@pytest.fixture
def gap(tmp_path: Path) -> Path:
    folder = tmp_path / "gap"
    folder.mkdir()
    for number in (1001, 1002, 1005):
        (folder / f"shot_v02.{number}.png").write_bytes(frame(number - 1001))
    return folder


def test_a_folder_with_a_gap(gap: Path) -> None:
    with pytest.raises(UnreadableMedia, match="1003 to 1004"):
        VideoReader(gap)
    assert marks(gap, missing="hold") == [0, 1, 1, 1, 4] and marks(gap, missing="skip") == [0, 1, 4]
    with VideoReader(gap, sequence=SequenceOptions(missing="skip", fps="24000/1001")) as reader:
        assert reader.index.numbers == (1001, 1002, 1005) and reader.fps == pytest.approx(23.976, abs=1e-3)
        assert "1003 to 1004 are missing" in reader.notes[0].message
    assert marks(gap / "shot_v02.####.png", missing="skip") == [0, 1, 4]
    assert marks(gap / "shot_v02.[1001-1002].png") == [0, 1]
    with pytest.raises(UnreadableMedia, match="1003"):
        VideoReader(gap / "shot_v02.[1001-1003].png")


def test_a_zip_has_its_options_inside(gap: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for file in gap.iterdir():
            archive.write(file, file.name)
    info = probe(path)
    assert (info.frames, info.numbers) == (3, [[1001, 1002, 1], [1005, 1005, 1]]) and "1003" in info.fault["message"]
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("sequence.json", SequenceOptions(missing="hold", fps=25).document())
    info = probe(path)
    assert (info.frames, info.fps, info.fault) == (5, 25, {}) and "1003 to 1004" in info.notes[0]


@pytest.mark.parametrize("text", ['{"missing": "guess"}', '{"fps": 0}', '{"fps": "a/b"}', '{"speed": 1}', "[]", "x"])
def test_wrong_options_are_refused(text: str, gap: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(gap / "shot_v02.1001.png", "1.png")
        archive.writestr("sequence.json", text)
    with pytest.raises(BadParameter) as caught:
        probe(path)
    assert "sequence.json" in caught.value.field and caught.value.remedy


def test_foreign_and_empty_files(gap: Path) -> None:
    (gap / "notes.txt").write_text("hello")
    (gap / "desktop.ini").write_text("[x]")
    with VideoReader(gap, sequence=SequenceOptions(missing="skip")) as reader:
        assert reader.notes[-1].message == "Files that are no images are left out: notes.txt."
    (gap / "shot_v02.1003.png").touch()
    with pytest.raises(UnreadableMedia, match=r"shot_v02\.1003\.png"):
        VideoReader(gap)


@pytest.mark.parametrize("first", [0, 1, 1001, -3])
def test_keys_belong_to_the_frames_of_their_numbers(first: int, tmp_path: Path) -> None:
    for number in (first, first + 6):
        (tmp_path / f"key_{number:05d}.png").write_bytes(frame(number - first))
    numbers = tuple(range(first, first + 12))
    images = NumberedImages(tmp_path, "inputs.keyframes")
    assert list(by_frame(images, numbers, "inputs.keyframes")) == [0, 6]
    with pytest.raises(UnreadableMedia) as caught:
        by_frame(images, numbers[1:6], "inputs.keyframes")
    assert f"{first + 1} to {first + 5}" in caught.value.remedy and str(first) in str(caught.value.value)


# -- archives


def test_a_zip_with_backslashes_is_one_with_folders(tmp_path: Path) -> None:
    for name, separator in (("slash", "/"), ("back", "\\")):
        with zipfile.ZipFile(tmp_path / f"{name}.zip", "w") as archive:
            for index in range(3):
                archive.writestr(zipfile.ZipInfo(f"shot{separator}frames{separator}{index + 1:04d}.png"), frame(index))
            archive.writestr(zipfile.ZipInfo(f"shot{separator}keyframes{separator}0001.png"), frame(0))
    assert probe(tmp_path / "back.zip") == probe(tmp_path / "slash.zip")
    assert marks(tmp_path / "back.zip") == [0, 1, 2]


@pytest.mark.parametrize("name", ["..\\up.png", "C:\\x.png", "\\\\server\\x.png", "a\x07b.png"])
def test_names_that_leave_the_archive_are_refused(name: str, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(zipfile.ZipInfo(name), frame(0))
    with pytest.raises(UnreadableMedia):
        probe(tmp_path / "a.zip")


@pytest.mark.parametrize("encoding", ["cp437", "latin-1", "utf-8", "shift_jis"])
def test_names_of_any_encoding(encoding: str, tmp_path: Path) -> None:
    """Programs write names as bytes of their system, without saying which."""
    path, raw = tmp_path / "a.zip", ("ééé" if encoding != "shift_jis" else "動画の").encode(encoding)
    with zipfile.ZipFile(path, "w") as archive:
        for index in range(3):
            archive.writestr(zipfile.ZipInfo("X" * len(raw) + f"_{index:03d}.png"), frame(index))
    path.write_bytes(path.read_bytes().replace(b"X" * len(raw), raw))
    assert probe(path).frames == 3 and not probe(path).fault
