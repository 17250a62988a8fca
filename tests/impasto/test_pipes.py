"""`impasto render - -o -`: YUV4MPEG2 and raw RGB, against FFmpeg's own reader and writer."""

from __future__ import annotations

import io
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
import pytest
from av.video.stream import VideoStream

from impasto.cli.app import run
from impasto.y4m import StreamFormat, Y4mReader, Y4mWriter, raw_frames
from pipeline.errors import UnreadableMedia
from pipeline.frames import Frame
from tests.conftest import TINY_HEIGHT, TINY_WIDTH, tiny_frame
from tests.processes import started

SIZE = (TINY_WIDTH, TINY_HEIGHT)
FRAMES = [tiny_frame(index) for index in range(4)]


def ffmpeg_writes(frames: list[Frame], pixel_format: str, rate: int = 12) -> bytes:
    """The frames as YUV4MPEG2 by FFmpeg's muxer."""
    with av.open(out := io.BytesIO(), "w", format="yuv4mpegpipe", options={"strict": "-1"}) as sink:
        stream = cast(VideoStream, sink.add_stream("rawvideo", rate=rate))
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = pixel_format
        for frame in frames:
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24").reformat(format=pixel_format)
            sink.mux(stream.encode(picture))
        sink.mux(stream.encode(None))
    return out.getvalue()


def ffmpeg_reads(data: bytes) -> tuple[list[Frame], Fraction]:
    with av.open(io.BytesIO(data), format="yuv4mpegpipe") as source:
        rate = source.streams.video[0].average_rate
        return [np.asarray(p.to_ndarray(format="rgb24"), np.uint8) for p in source.decode(video=0)], Fraction(rate or 0)


def close(one: Frame, other: Frame, mean: float) -> bool:
    return float(np.abs(one.astype(int) - other.astype(int)).mean()) < mean


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le"])
def test_streams_of_ffmpeg_are_read(pixel_format: str) -> None:
    reader = Y4mReader(io.BytesIO(ffmpeg_writes(FRAMES, pixel_format)))
    assert (reader.format.size, reader.format.fps, reader.format.pixel_format) == (SIZE, 12, pixel_format)
    read = list(reader)
    assert len(read) == len(FRAMES)
    assert all(close(one, other, 6) for one, other in zip(read, FRAMES, strict=True))


@pytest.mark.parametrize("size", [SIZE, (65, 49)])
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p", "yuv444p"])
def test_written_streams_are_read_by_ffmpeg(size: tuple[int, int], pixel_format: str) -> None:
    frames = [np.full((size[1], size[0], 3), (200, 90, 30), np.uint8)] * 3
    out = io.BytesIO()
    writer = Y4mWriter(out, StreamFormat(size, Fraction(30000, 1001), pixel_format))
    for frame in frames:
        writer.write(frame)
    read, rate = ffmpeg_reads(out.getvalue())
    assert (len(read), rate) == (3, Fraction(30000, 1001))
    assert all(close(one, other, 4) for one, other in zip(read, frames, strict=True))


def test_the_pixel_aspect_ratio_is_applied() -> None:
    data = ffmpeg_writes(FRAMES[:1], "yuv420p").replace(b" A0:0", b" A2:1").replace(b" A1:1", b" A2:1")
    assert next(iter(Y4mReader(io.BytesIO(data)))).shape == (TINY_HEIGHT, 2 * TINY_WIDTH, 3)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"RIFF", "cut off"),
        (b"RIFF\n", "not a YUV4MPEG2"),
        (b"YUV4MPEG2 W64 F25:1\n", "width and height"),
        (b"YUV4MPEG2 W64 H4x F25:1\n", "width and height"),
        (b"YUV4MPEG2 W64 H48 F0:0\n", "rate"),
        (b"YUV4MPEG2 W64 H48 F25:1 C411\n", "C411"),
        (b"YUV4MPEG2 W64 H48 F25:1 Im\n", "order of the fields"),
        (b"YUV4MPEG2 " + b"X" * 2000 + b"\n", "too long"),
        (b"YUV4MPEG2 W64 H48 F25:1\nFRAME\n" + bytes(100), "within frame 0"),
        (b"YUV4MPEG2 W64 H48 F25:1\nFROG\n", "begin with FRAME"),
        (b"YUV4MPEG2 W4 H4 F25:1\n", "too small"),
    ],
)
def test_invalid_streams_are_refused(data: bytes, text: str) -> None:
    with pytest.raises(UnreadableMedia, match=text):
        list(Y4mReader(io.BytesIO(data)))


def test_a_truncated_raw_frame_is_refused() -> None:
    data = FRAMES[0].tobytes() + b"xy"
    frames = raw_frames(io.BytesIO(data), SIZE)
    assert np.array_equal(next(frames), FRAMES[0])
    with pytest.raises(UnreadableMedia, match="within frame 1"):
        next(frames)


# -- the command, as a shell uses it


def pipe(*words: str, data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "impasto", "render", *words]
    return subprocess.run(command, input=data, capture_output=True, timeout=120, check=False)


def test_y4m_frames_are_rendered_through_a_pipe() -> None:
    done = pipe("-", "-o", "-", "-p", "lines=off", data=ffmpeg_writes(FRAMES, "yuv420p"))
    assert done.returncode == 0, done.stderr
    read, rate = ffmpeg_reads(done.stdout)
    assert (len(read), read[0].shape, rate) == (len(FRAMES), (TINY_HEIGHT, TINY_WIDTH, 3), 12)


def test_raw_frames_are_rendered_through_a_pipe() -> None:
    done = pipe("-", "-o", "-", "--raw", f"{TINY_WIDTH}x{TINY_HEIGHT}@12", data=b"".join(f.tobytes() for f in FRAMES))
    assert done.returncode == 0, done.stderr
    assert len(done.stdout) == sum(frame.nbytes for frame in FRAMES)


def test_frames_are_written_as_soon_as_they_are_rendered() -> None:
    data = ffmpeg_writes(FRAMES, "yuv420p")
    header, *frames = data.split(b"FRAME\n")
    command = [sys.executable, "-m", "impasto", "render", "-", "-o", "-", "-p", "lines=off"]
    with started(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(header + b"FRAME\n" + frames[0])
        process.stdin.flush()
        assert process.stdout.readline().startswith(b"YUV4MPEG2")  # while the second frame has not been sent
        assert process.stdout.readline() == b"FRAME\n"
        assert len(process.stdout.read(len(frames[0]))) == len(frames[0])
        process.stdin.close()
        assert process.stdout.read() == b""
        assert process.wait(60) == 0


def test_files_and_pipes_can_be_combined(tiny_clip: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    assert pipe("-", "-o", str(out), data=ffmpeg_writes(FRAMES, "yuv420p")).returncode == 0
    with av.open(str(out)) as made:
        assert (sum(1 for _ in made.decode(video=0)), made.streams.video[0].average_rate) == (len(FRAMES), 12)
    read, _ = ffmpeg_reads(pipe(str(tiny_clip), "-o", "-").stdout)
    assert read[0].shape == (TINY_HEIGHT, TINY_WIDTH, 3)


@pytest.mark.parametrize(
    "words",
    [
        ("--artefact", "svg"), ("--json",), ("--workers", "2"), ("--raw", "640"), ("--format", "webm"), ("--fps", "12"),
        ("--passes-to", "passes/"), ("--colour-in", "ACEScg"), ("--premultiplied",), ("--quality", "20"),
        ("--alpha", "source"), ("--overwrite",), ("--raw", "96x64", "--fields", "top"),
    ],
)  # fmt: skip
def test_options_incompatible_with_pipes_are_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["render", "-", "-o", "-", *words]) == 2
    assert words[-2 if "--fields" in words else 0] in capsys.readouterr().err


@pytest.mark.parametrize("size", ["30x20", f"{TINY_WIDTH}x{TINY_HEIGHT}@7"])
def test_raw_frames_of_a_file_have_its_size_and_rate(size: str, tiny_clip: Path) -> None:
    done = pipe(str(tiny_clip), "-o", "-", "--raw", size)
    assert (done.returncode, done.stdout) == (2, b"")
    assert f"Write --raw {TINY_WIDTH}x{TINY_HEIGHT}".encode() in done.stderr
    assert pipe(str(tiny_clip), "-o", "-", "--raw", f"{TINY_WIDTH}x{TINY_HEIGHT}").returncode == 0


def test_a_size_of_raw_frames_is_refused_for_files(tiny_clip: Path, tmp_path: Path) -> None:
    done = pipe(str(tiny_clip), "-o", str(tmp_path / "out.mp4"), "--raw", "96x64")
    assert (done.returncode, list(tmp_path.iterdir())) == (2, [])
    assert b"--raw is for pipes" in done.stderr
