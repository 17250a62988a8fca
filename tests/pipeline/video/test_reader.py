"""Exact frames of all kinds of containers, in any order of reads."""

from __future__ import annotations

import zlib
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import BadFrame, UnreadableMedia
from pipeline.frames import Frame
from pipeline.video import clip
from pipeline.video.reader import VideoReader
from pipeline.video.stills import encode_png
from tests.pipeline.video.making import make_video, make_zip, picture, png_frames

KINDS: dict[str, tuple[str, str, str, dict[str, str]]] = {
    "h264 with B-frames": ("a.mp4", "libx264", "yuv420p", {"g": "12", "bf": "3"}),
    "h264 open GOP": ("a.mp4", "libx264", "yuv420p", {"g": "10", "x264-params": "open-gop=1:bframes=3"}),
    "h264 all intra": ("a.mp4", "libx264", "yuv420p", {"g": "1"}),
    "h264 in mkv": ("a.mkv", "libx264", "yuv420p", {"g": "10"}),
    "h264 in ts": ("a.ts", "libx264", "yuv420p", {"g": "10"}),
    "h264 without a container": ("a.h264", "libx264", "yuv420p", {"g": "10"}),
    "vp8": (
        "a.webm",
        "libvpx",
        "yuv420p",
        {"g": "10", "deadline": "realtime", "auto-alt-ref": "1", "lag-in-frames": "9"},
    ),
    "vp9": ("a.webm", "libvpx-vp9", "yuv420p", {"g": "10", "deadline": "realtime", "cpu-used": "8"}),
    "mpeg4 in avi": ("a.avi", "mpeg4", "yuv420p", {"g": "10", "bf": "2", "b": "8000000"}),
    "gif": ("a.gif", "gif", "rgb8", {}),
    "ffv1 10 bit": ("a.mkv", "ffv1", "yuv420p10le", {}),
}


def levels(frames: list[Frame]) -> NDArray[np.float64]:
    """Indices of the frames, decoded from their mean red."""
    return np.array([(np.median(frame[..., 0]) - 20) / 6 for frame in frames])


@pytest.mark.parametrize("kind", KINDS)
def test_frames_do_not_depend_on_the_order_of_reads(kind: str, tmp_path: Path) -> None:
    name, codec, pixel_format, options = KINDS[kind]
    path = make_video(tmp_path / name, [picture(i) for i in range(36)], codec, pixel_format, options=options)
    with VideoReader(path) as reader:
        every = list(reader.read())
    assert len(every) == 36
    assert np.allclose(levels(every), range(36), atol=1.0 if kind != "gif" else 4.0)
    with VideoReader(path) as reader:
        for start in (30, 11, 12, 13, 0, 34, 9, 10, 1, 22):
            for at, frame in enumerate(reader.read(start, min(start + 3, 36)), start=start):
                assert np.array_equal(frame, every[at]), at
        assert reader.errors == []


def test_consecutive_reads_do_not_seek(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_video(tmp_path / "a.mp4", [picture(i) for i in range(30)], options={"g": "10"})
    opened: list[int] = []
    make = clip.Pass

    def counted(path: Path, index: object, start: int, *rest: object) -> object:
        opened.append(start)
        return make(path, index, start, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(clip, "Pass", counted)
    with VideoReader(path) as reader:
        for start in range(0, 30, 5):
            assert len(list(reader.read(start, start + 5))) == 5
        assert opened == [0]
        next(reader.read(27, 28))
        next(reader.read(5, 6))
        assert opened == [0, 20, 0]


def test_variable_rate_keeps_its_times(tmp_path: Path) -> None:
    pts = [0, 40, 80, 500, 520, 900, 2000]
    path = make_video(tmp_path / "v.mkv", [picture(i) for i in range(7)], pts=pts, time_base=Fraction(1, 1000))
    with VideoReader(path) as reader:
        assert list(reader.timestamps * reader.time_base * 1000) == pts
        assert np.allclose(levels(list(reader.read(3, 5))), [3, 4], atol=1)


@pytest.mark.parametrize(("ccw", "corner"), [(0, (0, 0)), (90, (1, 0)), (180, (1, 1)), (270, (0, 1))])
def test_rotation_is_applied(ccw: int, corner: tuple[int, int], tmp_path: Path) -> None:
    frame = np.zeros((48, 64, 3), np.uint8)
    frame[:24, :32] = 255
    with VideoReader(make_video(tmp_path / "r.mp4", [frame] * 2, rotation_ccw=ccw)) as reader:
        assert reader.size == ((64, 48) if ccw in (0, 180) else (48, 64))
        assert reader.rotation_deg == -ccw % 360
        shown = next(reader.read())
    quarters = [[shown[y, x, 0] > 128 for x in (8, -8)] for y in (8, -8)]
    assert quarters[corner[0]][corner[1]]
    assert sum(map(sum, quarters)) == 1


def test_non_square_pixels_are_resampled(tmp_path: Path) -> None:
    path = make_video(tmp_path / "w.mp4", [picture(0)] * 2, aspect=Fraction(4, 3))
    with VideoReader(path) as reader:
        assert reader.size == (128, 64)
        assert next(reader.read()).shape == (64, 128, 3)
    path = make_video(tmp_path / "h.mp4", [picture(0)] * 2, aspect=Fraction(3, 4))
    with VideoReader(path) as reader:
        assert reader.size == (96, 86)


def test_odd_sizes(tmp_path: Path) -> None:
    path = make_video(tmp_path / "o.webm", [picture(i, 97, 63) for i in range(3)], "libvpx-vp9", options={"crf": "10"})
    with VideoReader(path) as reader:
        assert reader.size == (97, 63)
        assert abs(next(reader.read()).astype(int) - picture(0, 97, 63)).mean() < 6


@pytest.mark.parametrize("matrix", [1, 6, 9])
@pytest.mark.parametrize("levels_range", [1, 2])
def test_colour_matrix_and_range_of_the_stream_are_used(matrix: int, levels_range: int, tmp_path: Path) -> None:
    frame = np.zeros((64, 96, 3), np.uint8)
    for number, colour in enumerate([(200, 40, 40), (40, 200, 40), (40, 40, 200), (230, 230, 60)]):
        frame[:, number * 24 : number * 24 + 24] = colour
    path = make_video(tmp_path / "m.mkv", [frame], "ffv1", "yuv444p", tags=(matrix, levels_range))
    with VideoReader(path) as reader:
        shown = next(reader.read())
    assert abs(shown.astype(int) - frame).max() <= 5


def test_untagged_video_is_bt709_from_720_rows(tmp_path: Path) -> None:
    for height, matrix in ((718, 6), (720, 1)):
        frame = np.full((height, 96, 3), (200, 60, 40), np.uint8)
        tagged = make_video(tmp_path / "t.mkv", [frame], "ffv1", "yuv444p", tags=(matrix, 1))
        planes = next(av.open(str(tagged)).decode(video=0)).to_ndarray()
        with av.open(str(tmp_path / "u.mkv"), "w") as out:
            stream = out.add_stream("ffv1", rate=25)
            stream.width, stream.height, stream.pix_fmt = 96, height, "yuv444p"
            out.mux(stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv444p")))
            out.mux(stream.encode(None))
        with VideoReader(tmp_path / "u.mkv") as reader:
            assert abs(next(reader.read()).astype(int) - frame).max() <= 5


ALPHA = {"a.mov": ("png", "rgba"), "a.webm": ("libvpx-vp9", "yuva420p"), "b.webm": ("libvpx", "yuva420p")}


@pytest.mark.parametrize("name", ALPHA)
def test_alpha_is_composited_over_white(name: str, tmp_path: Path) -> None:
    frame = np.zeros((64, 96, 4), np.uint8)
    frame[..., 0] = 200
    frame[:, 32:64, 3], frame[:, 64:, 3] = 128, 255
    codec, pixel_format = ALPHA[name]
    options = {} if codec == "png" else {"auto-alt-ref": "0"}
    with VideoReader(make_video(tmp_path / name, [frame] * 2, codec, pixel_format, options=options)) as reader:
        shown = next(reader.read())
    assert np.allclose(shown[32, [8, 48, 80]], [(255, 255, 255), (227, 127, 127), (200, 0, 0)], atol=2)


def test_damage_in_the_middle_is_reported_and_skipped(tmp_path: Path) -> None:
    frames = [picture(i) for i in range(30)]
    path = make_video(tmp_path / "d.avi", frames, "mjpeg", "yuvj420p")
    data = bytearray(path.read_bytes())
    starts = [i for i in range(len(data)) if data[i : i + 3] == b"\xff\xd8\xff"]
    data[starts[12] : starts[13] - 16] = bytes(starts[13] - 16 - starts[12])
    path.write_bytes(bytes(data))
    with VideoReader(path) as reader:
        every = list(reader.read())
        assert reader.errors
    assert len(every) == 30
    assert np.allclose(levels(every), [*range(12), 11, *range(13, 30)], atol=1)
    with VideoReader(path) as reader:
        parts = [frame for start in (12, 20) for frame in reader.read(start, start + 4)]
    assert all(np.array_equal(a, b) for a, b in zip(parts, every[12:16] + every[20:24], strict=True))


def test_a_truncated_file_is_read_up_to_its_end(tmp_path: Path) -> None:
    path = make_video(tmp_path / "c.mkv", [picture(i) for i in range(36)], options={"g": "6", "bf": "0"})
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    with VideoReader(path) as reader:
        frames = list(reader.read())
    assert 8 < len(frames) < 36
    assert np.allclose(levels(frames)[:-1], range(len(frames) - 1), atol=1)


def test_a_folder_a_zip_and_a_still_image_are_videos(tmp_path: Path) -> None:
    entries = png_frames(12)
    for name, data in entries.items():
        (tmp_path / name).write_bytes(data)
    archive = make_zip(tmp_path / "frames.zip", entries)
    still = tmp_path / "frame_3.png"
    for path, count in ((tmp_path, 12), (archive, 12), (still, 1)):
        with VideoReader(path) as reader:
            assert (reader.frames, reader.fps) == (count, 24.0)
            first = 3 if count == 1 else 0
            assert [int(x) for x in levels(list(reader.read()))] == list(range(first, first + count))
    with VideoReader(archive) as reader:
        assert np.array_equal(next(reader.read(10, 11)), picture(10))


def test_a_frame_of_another_size_is_named(tmp_path: Path) -> None:
    entries = png_frames(2) | {"frame_2.png": encode_png(picture(0, 64, 64))}
    with VideoReader(make_zip(tmp_path / "f.zip", entries)) as reader, pytest.raises(BadFrame, match=r"frame_2\.png"):
        list(reader.read())


def test_json_is_not_a_video(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(UnreadableMedia):
        VideoReader(tmp_path / "a.json")


_TURNED = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
"""EXIF data with the orientation 6: the picture is to be turned by 90 degrees."""


def test_exif_rotation_of_a_jpeg_is_applied(tmp_path: Path) -> None:
    encoded = cv2.imencode(".jpg", picture(0))[1].tobytes()
    exif = b"Exif\0\0" + _TURNED
    (tmp_path / "p.jpg").write_bytes(
        encoded[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + encoded[2:]
    )
    with VideoReader(tmp_path / "p.jpg") as reader:
        assert reader.size == (64, 96)


def test_exif_rotation_of_a_png_is_applied(tmp_path: Path) -> None:
    encoded, after_header = encode_png(picture(0)), 8 + 25
    chunk = b"eXIf" + _TURNED
    exif = len(_TURNED).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (tmp_path / "p.png").write_bytes(encoded[:after_header] + exif + encoded[after_header:])
    with VideoReader(tmp_path / "p.png") as reader:
        assert reader.size == (64, 96)


@pytest.mark.real("media")
def test_real_clips_seek_exactly(media: Path) -> None:
    for name in ("seattle_pan_640x360.avi", "head_turn.gif", "asl_walk_640x480.mkv", "carphone_qcif.mp4"):
        with VideoReader(media / "video" / name) as reader:
            sums = [int(frame.sum(dtype=np.int64)) for frame in reader.read()]
            assert len(sums) == reader.frames
            for start in (reader.frames - 2, reader.frames // 2, 3):
                again = [int(frame.sum(dtype=np.int64)) for frame in reader.read(start, start + 2)]
                assert again == sums[start : start + 2], name
