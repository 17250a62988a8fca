"""Every profile of every output format: pixel format, depth, colour tags, opacity, and the same bytes in each run."""

from __future__ import annotations

import io
import zipfile
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import OpenEXR
import pytest

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.formats import OUTPUTS
from pipeline.formats.base import Encoding
from pipeline.formats.decoding import decode_raw
from pipeline.video.join import join
from pipeline.video.media import Limits
from pipeline.video.reader import VideoReader
from pipeline.video.writer import SegmentSpec, segment_writer
from tests.pipeline.video.making import make_video, picture

W, H, COUNT, CUT = 320, 180, 6, 4
PROFILES = [(form.name, profile.name) for form in OUTPUTS.values() for profile in form.profiles]
WITH_ALPHA = [(f, p) for f, p in PROFILES if OUTPUTS[f].profile(p).has_alpha]
Y, X = np.mgrid[:H, :W]
FAST_CHROMA = 12
"""Mean error of 4:2:0 and 4:2:2 and of loss at quality 6, levels, for this picture."""


def frame(index: int, alpha: bool = False) -> AnyArray:
    colours = [(X * 255 // W + 3 * index) % 256, Y * 255 // H, np.full_like(X, 90)]
    return np.dstack([*colours, np.clip((X - 20 - index) * 8, 0, 255)] if alpha else colours).astype(np.uint8)


def made(folder: Path, form: str, profile: str, frames: list[AnyArray], quality: int = 6, height: int = H) -> Path:
    """The film of these frames, joined from two segments."""
    alpha, segments = frames[0].shape[2] == 4, []
    for start, stop in ((0, CUT), (CUT, len(frames))):
        spec = SegmentSpec(form, (frames[0].shape[1], height), Fraction(1, 25), 25.0, quality, profile, alpha)
        path = folder / f"segment-{start}"
        with segment_writer(path, spec) as writer:
            for index in range(start, stop):
                writer.write(index, frames[index], index, index + 1)
        segments.append((Fraction(start, 25), path))
    out = folder / f"film{(*OUTPUTS[form].suffixes, '.zip')[0]}"
    join(segments, out, Encoding(form, quality))
    return out


@pytest.mark.parametrize(("form", "profile"), PROFILES)
def test_a_film_has_its_frames_and_the_same_bytes_in_each_run(form: str, profile: str, tmp_path: Path) -> None:
    frames = [frame(index) for index in range(COUNT)]
    film = made(tmp_path, form, profile, frames)
    once = film.read_bytes()
    assert made(tmp_path, form, profile, frames).read_bytes() == once
    with VideoReader(film) as reader:
        got = list(reader.read())
    assert len(got) == COUNT
    worst = max(float(np.abs(a[:H, :W].astype(int) - b).mean()) for a, b in zip(got, frames, strict=True))
    assert worst <= FAST_CHROMA


@pytest.mark.parametrize(("form", "profile"), WITH_ALPHA)
def test_opacity_is_kept_within_a_level_over_any_background(form: str, profile: str, tmp_path: Path) -> None:
    """A lossy codec may differ more in the colours; what is transparent stays transparent."""
    frames = [frame(index, alpha=True) for index in range(COUNT)]
    film = made(tmp_path, form, profile, frames, quality=0)
    got = pictures(film)
    lossy = OUTPUTS[form].profile(profile).codec == "libvpx-vp9"
    for there, given in zip(got, frames, strict=True):
        assert there.shape == given.shape
        assert np.abs(there[..., 3].astype(int) - given[..., 3]).max() <= (2 if lossy else 1)
        for background in ((255, 0, 0), (0, 255, 0), (0, 0, 0)):
            a, b = over(there, background), over(given, background)
            assert np.abs(a - b).mean() < 4


def pictures(film: Path) -> list[AnyArray]:
    """The film's pictures with opacity, uint8."""
    if film.suffix == ".zip":
        with zipfile.ZipFile(film) as archive:
            raw = [decode_raw(archive.read(name), Limits()) for name in archive.namelist()]
        return [(p // 257).astype(np.uint8) if p.dtype == np.uint16 else p for p in raw]
    if film.suffix in (".webp", ".avif"):
        from PIL import Image, ImageSequence

        return [np.asarray(page.convert("RGBA")) for page in ImageSequence.Iterator(Image.open(film))]
    from pipeline.video.container import decoder_of, open_container

    with open_container(film, Limits()) as source:
        decoder = decoder_of(source.streams.video[0], Limits(), 1)
        decoded = [p for packet in source.demux(source.streams.video[0]) for p in decoder.decode(packet)]
    return [np.asarray(p.reformat(format="rgba").to_ndarray(), np.uint8) for p in decoded]


def over(rgba: AnyArray, background: tuple[int, int, int]) -> AnyArray:
    clear = rgba[..., 3:] / 255
    return rgba[..., :3] * clear + np.array(background) * (1 - clear)


STREAMS = {
    ("mov", "422hq"): ("prores", "apch", "yuv422p10le"),
    ("mov", "4444"): ("prores", "ap4h", "yuv444p12le"),  # the decoder's name of ten bits in twelve
    ("mov", "dnxhr-hqx"): ("dnxhd", "AVdh", "yuv422p10le"),
    ("mov", "dnxhr-444"): ("dnxhd", "AVdh", "yuv444p10le"),
    ("mp4", "h264"): ("h264", "avc1", "yuv420p"),
    ("mp4", "h264-444"): ("h264", "avc1", "yuv444p"),
    ("mp4", "hevc"): ("hevc", "hvc1", "yuv420p10le"),
    ("mp4", "av1"): ("libdav1d", "av01", "yuv420p10le"),
    ("mkv", "ffv1"): ("ffv1", None, "bgr0"),
    ("mkv", "ffv1-16"): ("ffv1", None, "gbrp16le"),
    ("mxf", "dnxhr-hqx"): ("dnxhd", None, "yuv422p10le"),
}


@pytest.mark.parametrize(("form", "profile"), STREAMS)
@pytest.mark.parametrize("height", [180, 720])
def test_codec_pixel_format_and_colour_tags(form: str, profile: str, height: int, tmp_path: Path) -> None:
    plain = np.full((height, W, 3), (200, 90, 40), np.uint8)
    film = made(tmp_path, form, profile, [plain] * COUNT, height=height)
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        shown = next(container.decode(stream))
        codec, tag, pixels = STREAMS[form, profile]
        assert (stream.codec_context.name, shown.format.name) == (codec, pixels)
        assert tag is None or stream.codec_context.codec_tag == tag
        is_rgb, hd = shown.format.is_rgb, height >= 720 or codec == "dnxhd"
        assert int(shown.colorspace) == (0 if is_rgb else 1 if hd else 6)
        assert (int(shown.color_primaries), int(shown.color_trc)) == ((1, 13) if is_rgb else (1, 1) if hd else (6, 6))
    with VideoReader(film) as reader:
        assert np.abs(next(reader.read(2, 3)).astype(int) - plain).max() <= 3


def test_depth_is_kept_to_the_file(tmp_path: Path) -> None:
    """A ramp of 1,024 steps keeps them in ten bits and more."""
    ramp = np.broadcast_to((np.arange(1024) * 64.06).astype(np.uint16)[None, :, None], (64, 1024, 3))
    frames = [np.ascontiguousarray(ramp)] * 5
    for form, profile, least in (
        ("png", "16", 1024),
        ("tiff", "16", 1024),
        ("mkv", "ffv1-16", 1024),
        ("exr", "half", 900),
    ):
        film = made(tmp_path, form, profile, frames, height=64)
        if film.suffix == ".zip":
            with zipfile.ZipFile(film) as archive:
                data = archive.read(archive.namelist()[0])
            if form == "exr":
                with OpenEXR.File(io.BytesIO(data)) as file:
                    row = file.channels()["RGB"].pixels[0, :, 0]
            else:
                row = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)[0, :, 0]
        else:
            with av.open(str(film)) as container:
                row = next(container.decode(video=0)).to_ndarray()[0, :, 0]
        assert len(np.unique(row)) >= least, (form, profile)
    film = made(tmp_path, "mov", "422hq", frames, height=64)
    with av.open(str(film)) as container:
        luma = next(container.decode(video=0))
        plane = np.frombuffer(memoryview(luma.planes[0]), "<u2").reshape(-1, luma.planes[0].line_size // 2)[10, :1024]
    assert len(np.unique(plane)) > 600  # 877 levels of limited range, less what the codec loses


def test_floating_point_frames_become_each_format(tmp_path: Path) -> None:
    values = np.linspace(0, 1, W, dtype=np.float32)
    frames = [np.ascontiguousarray(np.broadcast_to(values[None, :, None], (H, W, 3)))] * COUNT
    wanted = np.rint(values * 255).astype(int)
    for form, profile in (
        ("mp4", "h264"),
        ("mov", "4444"),
        ("png", "8"),
        ("png", "16"),
        ("exr", "half"),
        ("webp", "webp"),
    ):
        with VideoReader(made(tmp_path, form, profile, frames, quality=0)) as reader:
            assert np.abs(next(reader.read())[20, :, 1].astype(int) - wanted).max() <= 3, (form, profile)


def test_an_exr_is_linear_and_premultiplied_and_reads_back_exactly(tmp_path: Path) -> None:
    given = frame(0, alpha=True)
    film = made(tmp_path, "exr", "half", [given] * COUNT)
    with zipfile.ZipFile(film) as archive, OpenEXR.File(io.BytesIO(archive.read(archive.namelist()[0]))) as file:
        assert [channel.type() for channel in file.channels().values()] == [OpenEXR.HALF]
        header, pixels = dict(file.header()), file.channels()["RGBA"].pixels.astype(np.float32)
    assert header["colorInteropID"] == "lin_rec709_scene"
    clear = given[..., 3] / 255
    light = np.where(
        given[..., 0] / 255 <= 0.04045, given[..., 0] / 255 / 12.92, ((given[..., 0] / 255 + 0.055) / 1.055) ** 2.4
    )
    np.testing.assert_allclose(pixels[..., 3], clear, atol=5e-4)
    np.testing.assert_allclose(pixels[..., 0], light * clear, atol=5e-4)


def test_a_profile_that_cannot_is_refused_by_name(tmp_path: Path) -> None:
    for spec, field in (
        (SegmentSpec("mov", (96, 64), Fraction(1, 25), 25.0, 20, "dnxhr-hqx"), "output.profile"),
        (SegmentSpec("mov", (W, H), Fraction(1, 25), 25.0, 20, "9999"), "output.profile"),
        (SegmentSpec("mxf", (W, H), Fraction(1, 12), 12.0), "output.format"),
        (SegmentSpec("mp4", (W, H), Fraction(1, 25), 25.0, alpha=True), "output.alpha"),
    ):
        with pytest.raises(BadParameter) as caught:
            segment_writer(tmp_path / "s", spec)
        assert caught.value.field == field and (caught.value.remedy or field == "output.alpha")


SOUNDS = {"mov": "pcm_s24le", "mkv": "flac", "mxf": "pcm_s24le", "mp4": "aac", "webm": "opus"}


@pytest.mark.parametrize("form", SOUNDS)
def test_sound_has_the_usual_codec_of_the_container(form: str, tmp_path: Path) -> None:
    source = make_video(tmp_path / "source.mp4", [picture(i, W, H) for i in range(COUNT)], click_s=[0.1])
    film = made(tmp_path, form, "", [frame(index) for index in range(COUNT)])
    segments = [(Fraction(0), tmp_path / "segment-0"), (Fraction(CUT, 25), tmp_path / f"segment-{CUT}")]
    join(segments, film, form, source)
    with av.open(str(film)) as container:
        sound = container.streams.audio[0].codec_context
        assert (sound.codec.canonical_name, sound.sample_rate) == (SOUNDS[form], 48000)


def test_what_a_format_of_pictures_leaves_out_is_named(tmp_path: Path) -> None:
    source = make_video(tmp_path / "source.mp4", [picture(i, W, H) for i in range(COUNT)], click_s=[0.1])
    film = made(tmp_path, "exr", "half", [frame(index) for index in range(COUNT)])
    segments = [(Fraction(0), tmp_path / "segment-0"), (Fraction(CUT, 25), tmp_path / f"segment-{CUT}")]
    (note,) = join(segments, film, "exr", source)
    assert "sound (aac)" in note.message


def test_uneven_times_in_a_format_of_one_rate_are_named(tmp_path: Path) -> None:
    spec = SegmentSpec("mxf", (W, H), Fraction(1, 25), 25.0)
    with segment_writer(tmp_path / "s", spec) as writer:
        for index, (start, stop) in enumerate(((0, 1), (1, 3), (3, 4))):
            writer.write(index, frame(index), start, stop)
    (note,) = join([(Fraction(0), tmp_path / "s")], tmp_path / "o.mxf", "mxf")
    assert "one frame rate" in note.message
