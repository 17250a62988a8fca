"""Probing: invalid files are rejected with field and remedy, valid ones are described."""

from __future__ import annotations

import stat
import struct
import sys
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pipeline.errors import BadMedia, MediaTooLarge, NoVideoStream, UnreadableMedia
from pipeline.video.media import Limits
from pipeline.video.probe import probe, probe_guarded
from pipeline.video.stills import encode_png
from tests.pipeline.video.making import clicks, make_video, make_zip, picture, png_frames


def png_header(width: int, height: int) -> bytes:
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + body
        + struct.pack(">I", zlib.crc32(body))
        + b"\0\0\0\x40IDAT"
        + b"\0" * 64
    )


def jpeg_header(width: int, height: int) -> bytes:
    return b"\xff\xd8\xff\xc0" + struct.pack(">HBHHB", 17, 8, height, width, 3) + b"\0" * 64 + b"\xff\xd9"


def gif_header(width: int, height: int) -> bytes:
    image = b"\x2c" + struct.pack("<HHHH", 0, 0, width, height) + b"\0\x02\x02\x44\x01\0"
    return b"GIF89a" + struct.pack("<HH", width, height) + b"\x80\0\0\0\0\0\xff\xff\xff" + image + b";"


def cut(path: Path, keep: float) -> bytes:
    data = path.read_bytes()
    return data[: int(len(data) * keep)]


def noise_png() -> bytes:
    return encode_png(np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8))


def zipped(tmp: Path, entries: dict[str, bytes]) -> bytes:
    return make_zip(tmp / "made.zip", entries).read_bytes()


def zip_with_link(tmp: Path) -> bytes:
    entry = zipfile.ZipInfo("frame_1.png")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp / "link.zip", "w") as archive:
        archive.writestr(entry, "/etc/passwd")
    return (tmp / "link.zip").read_bytes()


def zip_bomb(tmp: Path) -> bytes:
    with zipfile.ZipFile(tmp / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("frame_1.png", bytes(8 << 20))
    return (tmp / "bomb.zip").read_bytes()


def sound_only(tmp: Path) -> bytes:
    with av.open(str(tmp / "sound.mp4"), "w") as out:
        stream = out.add_stream("aac", rate=48000, layout="mono")
        for packet in clicks(stream, [0.1], 0.3, 0.0):
            out.mux(packet)
    return (tmp / "sound.mp4").read_bytes()


def unknown_codec(tmp: Path) -> bytes:
    data = make_video(tmp / "u.mp4", [picture(0)]).read_bytes()
    return data.replace(b"avc1", b"zzz9").replace(b"avcC", b"zzzC")


def playlist(tmp: Path) -> bytes:
    return b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n"


BAD: dict[str, tuple[Callable[[Path], bytes], type[BadMedia]]] = {
    "empty": (lambda t: b"", UnreadableMedia),
    "truncated mp4": (lambda t: cut(make_video(t / "a.mp4", [picture(i) for i in range(9)]), 0.6), UnreadableMedia),
    "truncated png": (lambda t: noise_png()[:5000], UnreadableMedia),
    "truncated jpeg": (lambda t: cv2.imencode(".jpg", picture(0, 200, 200))[1].tobytes()[:3000], UnreadableMedia),
    "header of a png": (lambda t: png_header(64, 64)[:20], UnreadableMedia),
    "program": (lambda t: Path(sys.executable).read_bytes()[:9000], UnreadableMedia),
    "windows program": (lambda t: b"MZ" + bytes(500), UnreadableMedia),
    "script": (lambda t: b"#!/bin/sh\nrm -rf /\n", UnreadableMedia),
    "text": (lambda t: "Grüße aus der Datei\n".encode() * 300, UnreadableMedia),
    "playlist that names a file": (playlist, UnreadableMedia),
    "noise": (lambda t: np.random.default_rng(1).bytes(20000), UnreadableMedia),
    "zeros": (lambda t: bytes(20000), UnreadableMedia),
    "broken json": (lambda t: b'{"hue": [1, 2', UnreadableMedia),
    "deep json": (lambda t: b"[" * 200000, UnreadableMedia),
    "sound only": (sound_only, NoVideoStream),
    "unknown codec": (unknown_codec, UnreadableMedia),
    "huge png": (lambda t: png_header(20000, 20000), MediaTooLarge),
    "huge jpeg": (lambda t: jpeg_header(20000, 20000), MediaTooLarge),
    "huge gif": (lambda t: gif_header(20000, 20000), MediaTooLarge),
    "one pixel": (lambda t: encode_png(np.zeros((1, 1, 3), np.uint8)), UnreadableMedia),
    "small video": (lambda t: make_video(t / "s.mp4", [picture(0, 14, 14)]).read_bytes(), UnreadableMedia),
    "zip that climbs": (lambda t: zipped(t, {"../../frame_1.png": noise_png()}), UnreadableMedia),
    "zip that is absolute": (lambda t: zipped(t, {"/etc/frame_1.png": noise_png()}), UnreadableMedia),
    "zip with a drive": (lambda t: zipped(t, {"C:\\frame_1.png": noise_png()}), UnreadableMedia),
    "zip with a link": (zip_with_link, UnreadableMedia),
    "zip bomb": (zip_bomb, MediaTooLarge),
    "zip of text": (lambda t: zipped(t, {"readme.txt": b"hello"}), UnreadableMedia),
    "zip of a program named png": (lambda t: zipped(t, {"frame_1.png": b"MZ" + bytes(200)}), UnreadableMedia),
    "zip of two sizes": (lambda t: zipped(t, png_frames(1) | {"frame_2.png": noise_png()}), UnreadableMedia),
    "zip of a huge image": (lambda t: zipped(t, {"frame_1.png": png_header(20000, 20000)}), MediaTooLarge),
    "zip of nothing": (lambda t: zipped(t, {}), UnreadableMedia),
    "truncated zip": (lambda t: zipped(t, png_frames(3))[:-30], UnreadableMedia),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_media_are_rejected_with_a_remedy(name: str, tmp_path: Path) -> None:
    make, kind = BAD[name]
    file = tmp_path / "upload.mp4"
    file.write_bytes(make(tmp_path))
    with pytest.raises(BadMedia) as caught:
        probe(file)
    assert type(caught.value) is kind
    assert caught.value.field == "file"
    assert caught.value.remedy


def test_a_damaged_entry_is_rejected(tmp_path: Path) -> None:
    data = bytearray(zipped(tmp_path, {"frame_1.png": noise_png()}))
    data[2000:2400] = bytes(400)
    file = tmp_path / "damaged.zip"
    file.write_bytes(bytes(data))
    with pytest.raises(UnreadableMedia):
        probe(file)


def test_a_video_is_probed_regardless_of_its_name(tmp_path: Path) -> None:
    made = make_video(tmp_path / "a.mp4", [picture(i) for i in range(10)], click_s=[0.1])
    info = probe(made.rename(tmp_path / "innocent.txt"))
    assert (info.kind, info.media_type, info.width, info.height) == ("video", "video/mp4", 96, 64)
    assert (info.frames, info.fps, info.duration_s) == (10, 25.0, 0.4)
    assert (info.codec, info.pixel_format, info.has_audio, info.rotation_deg) == ("h264", "yuv420p", True, 0)


def test_an_image_is_one_frame(tmp_path: Path) -> None:
    for suffix, media_type in (
        (".png", "png"),
        (".jpg", "jpeg"),
        (".webp", "webp"),
        (".tiff", "tiff"),
        (".bmp", "bmp"),
    ):
        file = tmp_path / f"image{suffix}"
        file.write_bytes(cv2.imencode(suffix, picture(0))[1].tobytes())
        info = probe(file)
        assert (info.kind, info.media_type) == ("image", f"image/{media_type}")
        assert (info.width, info.height, info.frames) == (96, 64, 1)


def test_an_archive_is_a_sequence(tmp_path: Path) -> None:
    entries = png_frames(12) | {"__MACOSX/._frame_1.png": b"junk", ".DS_Store": b"junk"}
    info = probe(make_zip(tmp_path / "frames.zip", entries))
    assert (info.kind, info.frames, info.width, info.height, info.fps) == ("archive", 12, 96, 64, 24.0)


def test_a_json_file_is_probed(tmp_path: Path) -> None:
    file = tmp_path / "histogram.json"
    file.write_text('{"hue": [1, 2, 3]}')
    assert (probe(file).kind, probe(file).media_type) == ("json", "application/json")


def test_limits_are_enforced(tmp_path: Path) -> None:
    file = make_video(tmp_path / "a.mp4", [picture(i) for i in range(30)])
    for limits in (
        Limits(size_bytes=100),
        Limits(pixels=96 * 63),
        Limits(side_px=90),
        Limits(seconds=1),
        Limits(frames=29),
    ):
        with pytest.raises(MediaTooLarge):
            probe(file, limits)
    assert probe(file, Limits(pixels=96 * 64, side_px=96, seconds=1.2, frames=30)).frames == 30


def test_the_guarded_probe_gives_the_same_result(tmp_path: Path) -> None:
    good = make_video(tmp_path / "a.mp4", [picture(i) for i in range(3)])
    assert probe_guarded(good) == probe(good)
    bad = tmp_path / "bad.png"
    bad.write_bytes(png_header(20000, 20000))
    with pytest.raises(MediaTooLarge) as caught:
        probe_guarded(bad)
    assert (caught.value.field, caught.value.value) == ("file", "20000x20000")


def test_the_guarded_probe_survives_a_hang(tmp_path: Path) -> None:
    file = make_video(tmp_path / "a.mp4", [picture(0)])
    begin = time.monotonic()
    with pytest.raises(UnreadableMedia, match="too long"):
        probe_guarded(file, timeout_s=0.0001)
    assert time.monotonic() - begin < 5
