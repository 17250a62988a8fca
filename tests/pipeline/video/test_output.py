"""Segments, the joined file and its sound: frames, times, and reproducible bytes."""

from __future__ import annotations

import zipfile
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from pipeline.errors import BadFrame, BadParameter
from pipeline.formats import OUTPUTS
from pipeline.frames import Frame
from pipeline.video.contact_sheet import contact_sheet, fit, poster
from pipeline.video.join import join
from pipeline.video.media import MediaInfo
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer
from tests.pipeline.video.making import heard_clicks, make_video, picture


def render(source: Path, out: Path, container: str, cuts: tuple[int, ...] = (7, 20), quality: int = 16) -> Path:
    """The source's own frames, written as segments and joined."""
    segments = []
    with VideoReader(source) as reader:
        spec = SegmentSpec(container, reader.size, reader.time_base, reader.fps, quality)
        edges = [0, *(cut for cut in cuts if cut < reader.frames), reader.frames]
        for start, stop in pairwise(edges):
            path = out.with_name(f"{out.stem}-{start}.segment")
            segments.append((reader.index.time(start) * reader.time_base, path))
            with segment_writer(path, spec) as writer:
                for index, frame in enumerate(reader.read(start, stop), start=start):
                    writer.write(index, frame, reader.index.time(index), reader.index.time(index + 1))
        join(segments, out, container, source)
    return out


def frames_of(path: Path) -> list[Frame]:
    with VideoReader(path) as reader:
        return list(reader.read())


@pytest.fixture
def source(tmp_path: Path) -> Path:
    frames = [picture(i) for i in range(30)]
    return make_video(tmp_path / "source.mp4", frames, options={"crf": "10"}, click_s=[0.2, 0.8])


@pytest.mark.parametrize("container", [name for name in OUTPUTS if name != "mxf"])  # too small for DNxHR
def test_frames_survive_encoding_and_bytes_are_reproducible(container: str, source: Path, tmp_path: Path) -> None:
    first = render(source, tmp_path / "one.out", container)
    again = render(source, tmp_path / "two.out", container)
    assert first.read_bytes() == again.read_bytes()
    given, got = frames_of(source), frames_of(first)
    assert len(got) == len(given)
    worst = max(float(abs(a.astype(int) - b).mean()) for a, b in zip(given, got, strict=True))
    assert worst == 0 if container in ("png", "tiff", "exr", "mkv") else worst < (12 if container == "gif" else 4)


def test_mp4_has_properties_that_browsers_support(source: Path, tmp_path: Path) -> None:
    out = render(source, tmp_path / "out.mp4", "mp4")
    data = out.read_bytes()
    assert data.find(b"moov") < data.find(b"mdat")
    with av.open(str(out)) as container:
        video, audio = container.streams.video[0], container.streams.audio[0]
        assert (video.codec_context.name, video.profile, video.pix_fmt) == ("h264", "High", "yuv420p")
        assert (video.codec_context.colorspace, video.codec_context.color_range) == (6, 1)
        assert (audio.codec_context.codec.canonical_name, video.start_time) == ("aac", 0)
        keys = [p.is_keyframe for p in container.demux(video) if p.size]
    assert keys[0] and keys[7] and keys[20]


def test_hd_is_tagged_bt709(tmp_path: Path) -> None:
    spec = SegmentSpec("mp4", (32, 720), Fraction(1, 25), 25.0)
    frame = np.full((720, 32, 3), (180, 60, 90), np.uint8)
    with segment_writer(tmp_path / "s", spec) as writer:
        writer.write(0, frame, 0, 1)
    join([(Fraction(0), tmp_path / "s")], tmp_path / "o.mp4", "mp4")
    with av.open(str(tmp_path / "o.mp4")) as container:
        assert container.streams.video[0].codec_context.colorspace == 1
    assert abs(frames_of(tmp_path / "o.mp4")[0].astype(int) - frame).max() <= 6


@pytest.mark.parametrize(
    ("container", "name", "codec", "kept"),
    [
        ("mp4", "s.mp4", "aac", "aac"),
        ("mp4", "s.mp4", "libmp3lame", "mp3"),
        ("mp4", "s.mkv", "libopus", "aac"),
        ("mp4", "s.mkv", "pcm_s16le", "aac"),
        ("webm", "s.mkv", "libopus", "opus"),
        ("webm", "s.mp4", "aac", "opus"),
    ],
)
@pytest.mark.parametrize("start_s", [0.0, 0.24])
def test_sound_stays_synchronous(
    container: str, name: str, codec: str, kept: str, start_s: float, tmp_path: Path
) -> None:
    frames = [picture(i) for i in range(30)]
    at = [0.4, 0.9]
    made = make_video(tmp_path / name, frames, click_s=at, audio_codec=codec, audio_start_s=start_s)
    assert heard_clicks(made) == pytest.approx(at, abs=0.03)
    out = render(made, tmp_path / f"out.{container}", container)
    with av.open(str(out)) as opened:
        assert opened.streams.audio[0].codec_context.codec.canonical_name == kept
    assert heard_clicks(out) == pytest.approx(heard_clicks(made), abs=0.012)
    assert probe(out).duration_s == pytest.approx(1.2, abs=0.03)


def test_sound_before_the_first_picture_is_kept(tmp_path: Path) -> None:
    frames = [picture(i) for i in range(25)]
    made = make_video(tmp_path / "late.mkv", frames, pts=list(range(10, 35)), click_s=[0.6, 0.9])
    with VideoReader(made) as reader:
        late_s = float(reader.timestamps[0] * reader.time_base)
    assert late_s == pytest.approx(0.4, abs=0.03)
    out = render(made, tmp_path / "out.mp4", "mp4")
    assert heard_clicks(out) == pytest.approx(heard_clicks(made), abs=0.012)
    with VideoReader(out) as reader:
        assert float(reader.timestamps[0] * reader.time_base) == pytest.approx(late_s, abs=0.001)


@pytest.mark.parametrize("container", ["mp4", "webm"])
def test_variable_rate_is_kept(container: str, tmp_path: Path) -> None:
    pts = [0, 40, 80, 500, 520, 900, 2000, 2040, 2500, 2533]
    made = make_video(tmp_path / "v.mkv", [picture(i) for i in range(10)], pts=pts, time_base=Fraction(1, 1000))
    with VideoReader(render(made, tmp_path / "out", container, cuts=(3, 6))) as reader:
        assert [round(float(t * reader.time_base) * 1000) for t in reader.timestamps] == pts


def test_odd_sides_are_padded_in_h264_only(tmp_path: Path) -> None:
    frame = picture(0, 97, 63)
    for container, size in (("mp4", (98, 64)), ("webm", (97, 63)), ("png", (97, 63))):
        spec = SegmentSpec(container, (97, 63), Fraction(1, 25), 25.0, 10)  # type: ignore[arg-type]
        with segment_writer(tmp_path / "s", spec) as writer:
            for index in range(3):
                writer.write(index, frame, index, index + 1)
        join([(Fraction(0), tmp_path / "s")], tmp_path / "o", container)  # type: ignore[arg-type]
        with VideoReader(tmp_path / "o") as reader:
            assert (reader.size, spec.coded_size) == (size, size)
            assert abs(next(reader.read())[:63, :97].astype(int) - frame).mean() < 4


def test_pngs_are_numbered_from_0000(source: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(render(source, tmp_path / "out.zip", "png")) as archive:
        assert archive.namelist() == [f"{index:04d}.png" for index in range(30)]


def test_invalid_arguments_are_rejected(tmp_path: Path) -> None:
    spec = SegmentSpec("mp4", (96, 64), Fraction(1, 25), 25.0)
    with segment_writer(tmp_path / "s", spec) as writer, pytest.raises(BadFrame):
        writer.write(0, picture(0, 64, 64), 0, 1)
    for wrong in (SegmentSpec("avi", (96, 64), Fraction(1), 1.0), SegmentSpec("mp4", (96, 64), Fraction(1), 1.0, 52)):  # type: ignore[arg-type]
        with pytest.raises(BadParameter):
            segment_writer(tmp_path / "s", wrong)


def test_a_source_that_is_no_container_has_no_sound(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "still.png"), picture(0))
    out = render(tmp_path / "still.png", tmp_path / "out.mp4", "mp4")
    info = probe(out)
    assert (info.frames, info.has_audio) == (1, False)


def test_poster_and_sheet(source: Path) -> None:
    with VideoReader(source) as reader:
        first, sheet = poster(reader), contact_sheet(reader, tile_px=48)
        assert (first, sheet) == (poster(reader), contact_sheet(reader, tile_px=48))
    image = cv2.imdecode(np.frombuffer(sheet, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (3 * 36 + 4, 4 * 52 + 4, 3)
    shown = cv2.imdecode(np.frombuffer(first, np.uint8), cv2.IMREAD_COLOR)
    assert abs(int(np.median(shown[..., 2])) - int(np.median(picture(10)[..., 0]))) < 8


def test_fit_never_enlarges() -> None:
    assert fit(picture(0), 48).shape == (32, 48, 3)
    assert fit(picture(0), 4000).shape == (64, 96, 3)


def test_media_info_is_json() -> None:
    assert MediaInfo("json", "application/json").as_json()["kind"] == "json"
