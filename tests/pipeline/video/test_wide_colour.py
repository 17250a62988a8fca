"""HDR and wide-gamut sources become sRGB: white stays white, primaries are converted, and the conversion is named."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.formats import OUTPUTS
from pipeline.video.join import join
from pipeline.video.media import SourceOptions
from pipeline.video.reader import VideoReader
from pipeline.video.wide_colour import HLG, PQ, film_signal, film_values
from pipeline.video.wide_colour import shown as in_srgb
from pipeline.video.writer import SegmentSpec, check_colour, segment_writer

TO_2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
"""BT.2087: linear light of BT.709 to that of BT.2020."""


def clip(path: Path, rgb: np.ndarray, primaries: int, transfer: int) -> Path:
    """A lossless film of R'G'B' patches, uint16 (h, w, 3), with these tags."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = rgb.shape[1], rgb.shape[0], "gbrp16le"  # type: ignore[attr-defined]
        context = stream.codec_context
        context.color_primaries, context.color_trc = primaries, transfer  # type: ignore[attr-defined]
        context.colorspace, context.color_range = 0, 2  # type: ignore[attr-defined]
        for index in range(3):
            picture = av.VideoFrame.from_ndarray(rgb, format="rgb48le").reformat(format="gbrp16le")
            picture.pts, picture.time_base = index, Fraction(1, 25)
            out.mux(stream.encode(picture))  # type: ignore[attr-defined]
        out.mux(stream.encode(None))  # type: ignore[attr-defined]
    return path


def shown(path: Path, **options: object) -> tuple[np.ndarray, str]:
    with VideoReader(path, options=SourceOptions(**options)) as reader:  # type: ignore[arg-type]
        return next(reader.read())[16, 16].astype(int), " ".join(note.message for note in reader.notes)


def flat(value: object) -> np.ndarray:
    return np.ascontiguousarray(np.broadcast_to(np.rint(np.asarray(value) * 65535), (64, 64, 3)).astype(np.uint16))


@pytest.mark.parametrize(("transfer", "white", "name"), [(PQ, 0.5807, "PQ"), (HLG, 0.75, "HLG")])
def test_diffuse_white_is_white(transfer: int, white: float, name: str, tmp_path: Path) -> None:
    """203 cd/m2 are 58.07 % of PQ's signal and 75 % of HLG's (BT.2408)."""
    seen, notes = shown(clip(tmp_path / "a.mkv", flat([white] * 3), 9, transfer))
    assert (np.abs(seen - 255) <= 3).all() and f"BT.2020 {name}" in notes
    black, _ = shown(clip(tmp_path / "b.mkv", flat([0.0] * 3), 9, transfer))
    assert (black == 0).all()
    brighter, _ = shown(clip(tmp_path / "c.mkv", flat([white + 0.1] * 3), 9, transfer))
    assert (brighter >= seen).all()


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_highlights_keep_their_hue_and_their_order(transfer: int) -> None:
    """A flame of four times diffuse white stays orange, although its red and green are both above white; and of two
    grays above white, the brighter one is brighter."""
    wide = TO_2020 @ np.array([4.0, 2.0, 0.4])
    signal = pq(wide * 203) if transfer == PQ else hlg(wide * 203)
    flame = in_srgb(flat(signal), (9, transfer), SourceOptions())[0, 0] * 255
    assert flame[0] > 252 and 170 < flame[1] < 200 and 80 < flame[2] < 100
    steps = [in_srgb(flat([value] * 3), (9, transfer), SourceOptions())[0, 0, 0] for value in (0.8, 0.85, 0.9, 1.0)]
    assert steps == sorted(set(steps)) and steps[-1] <= 1


def pq(nits: np.ndarray) -> np.ndarray:
    """SMPTE ST 2084."""
    power = (nits / 10000) ** (2610 / 16384)
    return ((3424 / 4096 + 2413 / 128 * power) / (1 + 2392 / 128 * power)) ** (2523 / 32)


def hlg(nits: np.ndarray) -> np.ndarray:
    """BT.2100, for a display of 1000 cd/m2."""
    luminance = float(np.array([0.2627, 0.678, 0.0593]) @ nits) / 1000
    scene = nits / 1000 * luminance ** (1 / 1.2 - 1)
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), a * np.log(np.maximum(12 * scene - b, 1e-9)) + c)


def test_a_view_gives_highlights_more_room(tmp_path: Path) -> None:
    """The ACES 2.0 view of OpenColorIO: light of 2.03 is 209 (`production.md` has 209 for 2), of 9 is below white."""
    view = "ACES 2.0 - SDR 100 nits (Rec.709)"
    seen, notes = shown(clip(tmp_path / "a.mkv", flat([0.5807] * 3), 9, PQ), colour_view=view)
    assert np.abs(seen - 209).max() <= 2 and view in notes
    brighter, _ = shown(clip(tmp_path / "b.mkv", flat([0.74] * 3), 9, PQ), colour_view=view)
    assert (brighter > seen + 15).all() and (brighter < 250).all()


def test_a_view_of_a_display_s_colours_has_no_effect_and_says_so(tmp_path: Path) -> None:
    path = clip(tmp_path / "a.mkv", flat([0.2, 0.5, 0.7]), 1, 1)
    seen, notes = shown(path, colour_view="ACES 2.0 - SDR 100 nits (Rec.709)")
    assert (seen == shown(path)[0]).all() and "no effect" in notes


def test_a_colour_space_that_is_given_replaces_the_tags(tmp_path: Path) -> None:
    import PyOpenColorIO

    path = clip(tmp_path / "a.mkv", flat([0.45, 0.4, 0.35]), 9, PQ)
    seen, notes = shown(path, colour="ARRI LogC4")
    config = PyOpenColorIO.Config.CreateFromFile("ocio://studio-config-v4.0.0_aces-v2.0_ocio-v2.5")
    processor = config.getProcessor("ARRI LogC4", "sRGB - Display").getDefaultCPUProcessor()
    wanted = np.clip(np.array(processor.applyRGB([0.45, 0.4, 0.35])) * 255, 0, 255)
    assert np.abs(seen - wanted).max() <= 1 and "ARRI LogC4, as given" in notes and "PQ" not in notes


@pytest.mark.parametrize(("options", "field"), [
    ({"colour": "ACEScq"}, "source.colour"), ({"colour": "ACEScg", "colour_view": "none"}, "source.colour_view"),
])  # fmt: skip
def test_unknown_names_are_refused_with_the_names_that_exist(
    options: dict[str, object], field: str, tmp_path: Path
) -> None:
    path = clip(tmp_path / "a.mkv", flat([0.4] * 3), 1, 1)
    with pytest.raises(BadParameter) as caught:
        shown(path, **options)
    assert (
        caught.value.field == field
        and ("ACEScg" if "colour_view" not in options else "ACES 2.0") in caught.value.remedy
    )


def test_primaries_of_p3_are_converted(tmp_path: Path) -> None:
    """Display P3 (0.8, 0.4, 0.2) is about (0.861, 0.376, 0.103) in sRGB."""
    seen, notes = shown(clip(tmp_path / "a.mkv", flat([0.8, 0.4, 0.2]), 12, 13))
    light = np.array([[1.2249, -0.2247, 0.0], [-0.042, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]]) @ decoded(
        [0.8, 0.4, 0.2]
    )
    assert (
        np.abs(seen - np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055) * 255).max() <= 1
    )
    assert "from P3 to sRGB" in notes


def decoded(values: list[float]) -> np.ndarray:
    encoded = np.array(values)
    return np.where(encoded < 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def test_primaries_of_bt2020_in_sdr_are_converted(tmp_path: Path) -> None:
    rng, errors = np.random.default_rng(5), []
    for number in range(6):
        wanted = rng.integers(20, 256, 3)
        wide = TO_2020 @ (wanted / 255) ** 2.4  # light of the display, BT.1886
        path = clip(tmp_path / f"{number}.mkv", flat(wide ** (1 / 2.4)), 9, 14)
        seen, notes = shown(path)
        errors.append(np.abs(seen - wanted))
        assert "from BT.2020 to sRGB" in notes
    assert np.mean(errors) < 0.5 and np.max(errors) <= 1


def test_bt709_is_left_alone_and_opacity_is_kept(tmp_path: Path) -> None:
    seen, notes = shown(clip(tmp_path / "a.mkv", flat([0.2, 0.5, 0.7]), 1, 1))
    assert np.abs(seen - np.array([51, 128, 179])).max() <= 1 and "converted" not in notes
    rgba = np.dstack([flat([0.5, 0.5, 0.5]), np.full((64, 64), 32896, np.uint16)])
    assert np.allclose(in_srgb(rgba, (9, PQ), SourceOptions())[..., 3], 128 / 255, atol=1e-4)


@pytest.mark.parametrize("deep", [False, True])
@pytest.mark.parametrize("pixels", ["yuv444p10le", "yuv422p10le", "yuv420p10le"])
def test_bars_of_ten_bits_come_in_within_half_a_level(pixels: str, deep: bool, tmp_path: Path) -> None:
    """Patches of R'G'B' as BT.709 of limited range, ten bit, by the equations of BT.709."""
    wanted = np.random.default_rng(7).random((24, 32, 3))
    red, green, blue = np.moveaxis(wanted, -1, 0)
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    planes = [876 * luma + 64, 896 * (blue - luma) / 1.8556 + 512, 896 * (red - luma) / 1.5748 + 512]
    stored = [np.rint(plane).astype(np.uint16).repeat(16, 0).repeat(16, 1) for plane in planes]
    with av.open(str(tmp_path / "bars.mkv"), "w") as out:
        stream = out.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 512, 384, pixels  # type: ignore[attr-defined]
        context = stream.codec_context
        context.colorspace, context.color_range = 1, 1  # type: ignore[attr-defined]
        context.color_primaries, context.color_trc = 1, 1  # type: ignore[attr-defined]
        picture = av.VideoFrame(512, 384, pixels)
        for plane, values in zip(picture.planes, stored, strict=True):
            small = values[:: 384 // plane.height, :: 512 // plane.width]
            plane.update(np.pad(small, ((0, 0), (0, plane.line_size // 2 - plane.width))).tobytes())
        picture.pts, picture.time_base = 0, Fraction(1, 25)
        out.mux(stream.encode(picture))  # type: ignore[attr-defined]
        out.mux(stream.encode(None))  # type: ignore[attr-defined]
    with VideoReader(tmp_path / "bars.mkv", options=SourceOptions(deep=deep)) as reader:
        frame = next(reader.read())
    assert frame.dtype == (np.uint16 if deep else np.uint8)
    error = frame[8::16, 8::16] / (257 if deep else 1) - wanted * 255
    assert np.abs(error).mean() < (0.2 if deep else 0.5) and np.abs(error).max() < 1.5
    assert abs(error.mean()) < 0.1, "neither darker nor brighter"


AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
"""Chromaticities of ACEScg."""


@pytest.mark.parametrize("tag", [{"chromaticities": AP1}, {"colorInteropID": "lin_ap1_scene"}])
def test_an_exr_of_acescg_is_converted(tag: dict[str, object], tmp_path: Path) -> None:
    """The values of OpenColorIO, ACEScg to sRGB: 255, 24, 44."""
    import OpenEXR

    pixels = np.broadcast_to(np.array((0.8, 0.1, 0.05), np.float16), (64, 64, 3))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | tag
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}) as file:
        file.write(str(tmp_path / "plate.1001.exr"))
    seen, notes = shown(tmp_path / "plate.1001.exr")
    assert np.abs(seen - np.array([255, 24, 44])).max() <= 2 and "converted to Rec. 709" in notes


HDR_PROFILES = [(form.name, each.name) for form in OUTPUTS.values() for each in form.profiles if each.has_hdr]


def hdr_film(path: Path, form: str, profile: str, colour: str, view: str = "") -> tuple[Path, np.ndarray]:
    """A film of patches, and their colours, sRGB 0..255."""
    rng = np.random.default_rng(7)
    patches = np.vstack([rng.integers(0, 256, (13, 3)), [[255, 255, 255], [0, 0, 0], [128, 128, 128]]])
    frame = np.kron(patches.reshape(4, 4, 3), np.ones((32, 32, 1))) / np.float32(255)
    spec = SegmentSpec(form, (128, 128), Fraction(1, 25), 25.0, 2, profile, colour=colour, colour_view=view)
    with segment_writer(path / "segment", spec) as writer:
        for index in range(3):
            writer.write(index, frame.astype(np.float32), index, index + 1)
    film = path / f"film.{form}"
    join([(Fraction(0), path / "segment")], film, form)
    return film, patches.reshape(4, 4, 3)


def tags(path: Path) -> tuple[str, int, tuple[int, int, int]]:
    """Pixel format, range, and primaries, transfer and matrix (ISO/IEC 23091-2), as the container has them."""
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        found = int(context.color_primaries), int(context.color_trc), int(context.colorspace)
        return str(context.pix_fmt), int(context.color_range), found


@pytest.mark.parametrize("colour", ["PQ", "HLG"])
@pytest.mark.parametrize(("form", "profile"), HDR_PROFILES)
def test_a_film_can_be_hdr(form: str, profile: str, colour: str, tmp_path: Path) -> None:
    film, patches = hdr_film(tmp_path, form, profile, colour)
    is_rgb = profile == "ffv1-16"
    pixels, range_, codes = tags(film)
    assert codes == (9, {"PQ": PQ, "HLG": HLG}[colour], 0 if is_rgb else 9)
    assert range_ == (2 if is_rgb else 1) and pixels.endswith("16le" if is_rgb else ("10le", "12le"))
    with VideoReader(film) as reader:
        centres = next(reader.read())[16::32, 16::32].astype(int)
        assert any(f"BT.2020 {colour}" in note.message for note in reader.notes)
    assert np.abs(centres - patches).mean() < 1.2 and np.abs(centres - patches)[patches.min(-1) > 20].max() <= 4


@pytest.mark.parametrize(("colour", "white"), [("PQ", 0.5807), ("HLG", 0.75)])
def test_white_of_an_hdr_film_is_diffuse_white(colour: str, white: float) -> None:
    """203 cd/m2 are 58.07 % of PQ's signal and 75 % of HLG's (BT.2408)."""
    signal = film_signal(colour)
    assert signal is not None and film_signal(f"{colour.lower()}_rec2020_display") == signal
    for dtype, full in ((np.uint8, 255), (np.uint16, 65535), (np.float32, 1)):
        picture = np.full((2, 2, 4), full, dtype)
        found = film_values(picture, signal)
        np.testing.assert_allclose(found[0, 0], [white] * 3 + [1], atol=1e-3)


def test_the_inverse_of_a_view_gives_highlights_back() -> None:
    """Light of 600 cd/m2 that is painted through a view goes out as it came in."""
    view, signal = "ACES 2.0 - SDR 100 nits (Rec.709)", (9, PQ)
    given = np.broadcast_to(pq(TO_2020 @ np.array([600.0, 300.0, 150.0])), (4, 4, 3)).astype(np.float32)
    painted = in_srgb(given, signal, SourceOptions(colour_view=view))
    assert painted.max() < 1
    np.testing.assert_allclose(film_values(painted, signal, view), given, atol=2e-3)


@pytest.mark.parametrize(("form", "profile", "colour"), [
    ("mp4", "h264", "PQ"), ("mov", "dnxhr-hqx", "HLG"), ("webm", "", "PQ"), ("mp4", "hevc", "ACEScg"),
    ("png", "16", "PQ"),
])  # fmt: skip
def test_a_profile_without_hdr_names_those_that_have_it(form: str, profile: str, colour: str) -> None:
    with pytest.raises(BadParameter) as caught:
        check_colour(form, OUTPUTS[form].profile(profile), colour)
    assert caught.value.field == "output.colour" and caught.value.value == colour
    assert ("mp4 hevc" if profile in ("h264", "dnxhr-hqx", "") else "HLG") in str(caught.value.remedy)
