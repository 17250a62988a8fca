"""Damage of a video is detected and counted, and intact videos are not reported."""

from __future__ import annotations

import struct
from fractions import Fraction
from pathlib import Path

import pytest

from pipeline.video.damage import Damage, damage_of, merged, runs_of
from pipeline.video.guard.reader import GuardedReader
from pipeline.video.media import Limits
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from tests.pipeline.video.making import make_video, picture

FRAMES = 96
CONTAINERS = {"a.mp4": "libx264", "a.mkv": "libx264", "a.webm": "libvpx", "a.avi": "mjpeg", "a.flv": "flv1"}
REAL = ("asl_walk_640x480.mkv", "head_turn.gif", "carphone_qcif.mp4", "seattle_pan_640x360.avi")


def video(path: Path, codec: str, **options: object) -> Path:
    pixel_format = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    encoder = "flv" if codec == "flv1" else codec
    return make_video(
        path, [picture(i) for i in range(FRAMES)], encoder, pixel_format,
        options={"g": "12", "bf": "0"} if codec == "libx264" else {}, **options,
    )  # fmt: skip


def damage(path: Path) -> tuple[int, Damage]:
    """Number of frames that are read, and the damage."""
    with VideoReader(path) as reader:
        return sum(1 for _ in reader.read()), damage_of(reader.index, reader.unreadable)


def cut_off(path: Path, share: float) -> Path:
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    return path


@pytest.mark.parametrize("name", ["a.mkv", "a.webm", "a.avi", "a.flv"])
def test_a_truncated_file_lacks_the_frames_after_its_end(name: str, tmp_path: Path) -> None:
    whole = video(tmp_path / name, CONTAINERS[name])
    assert damage(whole) == (FRAMES, Damage(FRAMES))
    count, found = damage(cut_off(whole, 0.5))
    assert 8 < count < FRAMES
    assert found.frames == FRAMES and found.missing == ((count, FRAMES),)
    assert found.describe().startswith(f"The source is damaged: frames {count}-95 of 96 are missing")


def test_a_truncated_mp4_lacks_the_frames_after_its_end(tmp_path: Path) -> None:
    whole = tmp_path / "fast.mp4"
    front = video(tmp_path / "a.mp4", "libx264").read_bytes()
    whole.write_bytes(_moov_first(front))
    assert damage(whole) == (FRAMES, Damage(FRAMES))
    count, found = damage(cut_off(whole, 0.6))
    assert 4 < count < FRAMES and found.missing == ((count, FRAMES),)


def _moov_first(data: bytes) -> bytes:
    """The same MP4 with its sample table before the samples."""
    at, boxes = 0, {}
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        boxes[kind] = data[at : at + size]
        at += size
    moov = bytearray(boxes[b"moov"])
    place = moov.find(b"stco")
    (count,) = struct.unpack(">I", moov[place + 8 : place + 12])
    for number in range(count):
        where = place + 12 + 4 * number
        (offset,) = struct.unpack(">I", moov[where : where + 4])
        moov[where : where + 4] = struct.pack(">I", offset + len(moov))
    return boxes[b"ftyp"] + bytes(moov) + boxes.get(b"free", b"") + boxes[b"mdat"]


def test_sound_that_is_longer_than_the_video_is_no_damage(tmp_path: Path) -> None:
    for name in ("s.mkv", "s.mp4"):
        path = make_video(tmp_path / name, [picture(i) for i in range(24)], click_s=[0.5])
        assert damage(path) == (24, Damage(24))


@pytest.mark.parametrize("name", ["v.mkv", "v.mp4"])
def test_a_variable_frame_rate_is_no_damage(name: str, tmp_path: Path) -> None:
    times = [0, 1, 2, 3, 9, 10, 30, 31, 32, 60, 61, 100]
    path = make_video(
        tmp_path / name, [picture(i) for i in range(12)], pts=times, time_base=Fraction(1, 25), options={"bf": "0"}
    )
    assert damage(path) == (12, Damage(12))


def test_random_bytes_in_the_middle_are_counted(tmp_path: Path) -> None:
    path = video(tmp_path / "r.avi", "mjpeg")
    data = bytearray(path.read_bytes())
    starts = [i for i in range(len(data)) if data[i : i + 3] == b"\xff\xd8\xff"]
    data[starts[40] : starts[44]] = bytes(starts[44] - starts[40])
    path.write_bytes(bytes(data))
    with GuardedReader(path) as reader:
        assert sum(1 for _ in reader.read()) <= FRAMES
        found = damage_of(reader.index, reader.unreadable)
    assert found and sum(stop - start for start, stop in (*found.unreadable, *found.missing)) >= 4


def test_a_hole_in_a_file_without_a_table_of_frames_is_counted(tmp_path: Path) -> None:
    path = video(tmp_path / "h.mkv", "libx264")
    data = bytearray(path.read_bytes())
    data[len(data) // 3 : len(data) // 2] = bytes(len(data) // 2 - len(data) // 3)
    path.write_bytes(bytes(data))
    count, found = damage(path)
    lost = sum(stop - start for start, stop in (*found.missing, *found.unreadable))
    assert found.frames == FRAMES and count + lost >= FRAMES - 1


def test_a_cut_off_gif_shows_its_last_frame_in_part(tmp_path: Path) -> None:
    path = make_video(tmp_path / "g.gif", [picture(i) for i in range(12)], "gif", "rgb8")
    assert damage(path) == (12, Damage(12))
    count, found = damage(cut_off(path, 0.6))
    assert found == Damage(count, ((count - 1, count),))


def test_the_probe_names_what_is_missing(tmp_path: Path) -> None:
    path = video(tmp_path / "p.mkv", "libx264")
    assert probe(path).damage == ""
    found = probe(cut_off(path, 0.5), Limits())
    assert found.damage == f"The file is damaged: frames {found.frames}-95 of 96 are missing."


def test_damage_is_described_in_one_sentence() -> None:
    found = Damage(96, ((3, 4),), ((22, 96),))
    assert found.describe() == "The source is damaged: frames 22-95 of 96 are missing and frame 3 of 96 is unreadable."
    assert Damage(9, ((0, 2), (3, 4), (5, 6), (7, 8))).describe("It") == (
        "It is damaged: frames 0-1, 3, 5 and 1 more run of 9 are unreadable."
    )
    assert Damage(9).describe() == "" and not Damage(9)
    assert Damage.from_json(found.as_json()) == found


def test_reports_of_the_same_file_add_up() -> None:
    first, second = Damage(96, ((3, 5),)), Damage(96, ((4, 9),), ((90, 96),))
    assert first.union(second) == Damage(96, ((3, 9),), ((90, 96),))
    assert runs_of([4, 1, 2]) == ((1, 3), (4, 5))
    many = merged((i, i + 1) for i in range(0, 6000, 2))
    assert len(many) <= 1000 and many[0][0] == 0 and many[-1][1] == 5999


@pytest.mark.real("media")
def test_no_real_clip_is_suspected(media: Path) -> None:
    for path in sorted((media / "video").iterdir()):
        with VideoReader(path) as reader:
            count = reader.frames
            tail = list(reader.read(max(0, count - 3)))
            assert tail and not damage_of(reader.index, reader.unreadable), path.name


@pytest.mark.real("media")
@pytest.mark.parametrize("name", REAL)
def test_a_real_clip_that_is_read_whole_is_whole(name: str, media: Path) -> None:
    count, found = damage(media / "video" / name)
    assert found == Damage(count)
