"""One door a format: registry, names in the code, and stills of all kinds against Pillow."""

from __future__ import annotations

import io
import re
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageCms, ImageOps

from pipeline.errors import MediaTooLarge, UnreadableMedia
from pipeline.formats import IMAGES, OUTPUTS, image_format
from pipeline.formats.decoding import decode_raw, decode_rgb
from pipeline.formats.dpx import DPX
from pipeline.video.media import Limits
from pipeline.video.probe import probe
from pipeline.video.reader import VideoReader
from service import page_formats
from tests.fuzz import media

ROOT = Path(__file__).parents[3]
WORDS = {
    "GIF": re.compile(r"(?<![A-Za-z])gif(?![a-z])|GIF|Gif(?![a-z])"),
    "EXR": re.compile(r"(?<![A-Za-z])exr(?![a-z])|EXR|Exr(?![a-z])"),
}
NOT_OURS = {"node_modules", "dist", "types", "test"}


@pytest.mark.parametrize("word", WORDS)
def test_a_format_is_named_in_few_files(word: str) -> None:
    """A new format should take one module and one row of the registry."""
    files = [path for root in ("impasto", "service", "workers", "pipeline") for path in (ROOT / root).rglob("*")
             if path.suffix in (".py", ".ts", ".tsx") and not NOT_OURS & set(path.relative_to(ROOT).parts)]  # fmt: skip
    naming = [str(path.relative_to(ROOT)) for path in files if WORDS[word].search(path.read_text())]
    assert len(naming) <= 4, naming


def test_every_format_has_names_of_its_own() -> None:
    suffixes = [suffix for form in IMAGES for suffix in form.suffixes]
    assert len(set(suffixes)) == len(suffixes)
    assert len({form.name for form in IMAGES}) == len({form.media_type for form in IMAGES}) == len(IMAGES)
    assert list(OUTPUTS) == [form.name for form in OUTPUTS.values()]


def test_the_pages_have_the_formats_of_the_registry() -> None:
    assert page_formats.FILE.read_text() == page_formats.document(), "run python -m service.page_formats"


# -- stills

Y, X = np.mgrid[:48, :96]
RGB = np.stack([X * 255 // 95, Y * 255 // 47, ((X // 8 + Y // 8) % 2) * 180], -1).astype(np.uint8)
ALPHA = np.where(X < 48, 255, np.where(Y < 24, 128, 0)).astype(np.uint8)
COLOUR, CLEAR = Image.fromarray(RGB), Image.fromarray(np.dstack([RGB, ALPHA]))
GRAY = COLOUR.convert("L")
TURNED = Image.Exif()
TURNED[0x0112] = 6


def encoded(image: Image.Image, suffix: str, **options: Any) -> bytes:
    out = io.BytesIO()
    image.save(out, suffix, **options)
    return out.getvalue()


KINDS: dict[str, bytes] = {
    "png": encoded(COLOUR, "PNG"),
    "png with alpha": encoded(CLEAR, "PNG"),
    "png gray with alpha": encoded(CLEAR.convert("LA"), "PNG"),
    "png palette": encoded(COLOUR.quantize(16), "PNG"),
    "png palette with tRNS": encoded(CLEAR.quantize(64), "PNG"),
    "png colour key": encoded(COLOUR, "PNG", transparency=tuple(int(v) for v in RGB[10, 20])),
    "png gray key": encoded(GRAY, "PNG", transparency=77),
    "png 1 bit": encoded(GRAY.convert("1"), "PNG"),
    "png turned": encoded(CLEAR, "PNG", exif=TURNED),
    "jpeg": encoded(COLOUR, "JPEG", quality=90),
    "jpeg gray": encoded(GRAY, "JPEG"),
    "jpeg cmyk": encoded(COLOUR.convert("CMYK"), "JPEG"),
    "jpeg turned": encoded(COLOUR, "JPEG", exif=TURNED),
    "webp turned with alpha": encoded(CLEAR, "WEBP", exif=TURNED, lossless=True),
    "avif": encoded(COLOUR, "AVIF", quality=90),
    "avif with alpha": encoded(CLEAR, "AVIF", quality=90),
    "tiff with alpha": encoded(CLEAR, "TIFF"),
    "tiff lzw": encoded(COLOUR, "TIFF", compression="tiff_lzw"),
    "tiff big": encoded(COLOUR, "TIFF", big_tiff=True),
    "tiff cmyk": encoded(COLOUR.convert("CMYK"), "TIFF"),
    "tiff lab": encoded(COLOUR.convert("LAB"), "TIFF"),
    "tiff two pages": encoded(COLOUR, "TIFF", save_all=True, append_images=[Image.new("RGB", (96, 48))]),
    "bmp": encoded(COLOUR, "BMP"),
    "gif": encoded(COLOUR.quantize(64), "GIF"),
    "targa": encoded(COLOUR, "TGA"),
    "targa rle with alpha": encoded(CLEAR, "TGA", compression="tga_rle"),
    "jpeg 2000": encoded(COLOUR, "JPEG2000"),
    "pnm": encoded(COLOUR, "PPM"),
    "pcx": encoded(COLOUR, "PCX"),
    "ico": encoded(COLOUR.resize((48, 48)), "ICO", sizes=[(48, 48)]),
    "sgi": encoded(COLOUR, "SGI"),
}


def by_pillow(data: bytes) -> np.ndarray:
    image = ImageOps.exif_transpose(Image.open(io.BytesIO(data)))
    assert image is not None
    if image.has_transparency_data:
        image = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image.convert("RGBA"))
    return np.asarray(image.convert("RGB"), np.int16)


@pytest.mark.parametrize("kind", KINDS)
def test_a_still_is_as_pillow_shows_it_over_white(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "upload"
    path.write_bytes(KINDS[kind])
    wanted, info = by_pillow(KINDS[kind]), probe(path)
    assert (info.kind, info.width, info.height, info.frames) == ("image", wanted.shape[1], wanted.shape[0], 1)
    with VideoReader(path) as reader:
        (frame,) = reader.read()
    assert np.abs(frame - wanted).max() <= 2


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_tiff_of_many_bits_keeps_them(dtype: Any) -> None:
    import cv2

    deep = (RGB.astype(np.float32) / 255 * (65535 if dtype is np.uint16 else 1)).astype(dtype)
    data = cv2.imencode(".tif", deep[..., ::-1])[1].tobytes()
    raw = decode_raw(data, Limits())
    assert raw.dtype == dtype
    np.testing.assert_array_equal(raw, deep)
    assert np.abs(decode_rgb(data, Limits()).astype(int) - RGB).max() <= 1


@pytest.mark.parametrize("layout", ["side by side", "planes", "premultiplied", "CMYK"])
def test_sixteen_bit_tiffs_of_every_layout_have_pillows_colours(layout: str, tmp_path: Path) -> None:
    """OpenCV reads planes and premultiplied colours of TIFF wrongly, without a word."""
    data = _tiff16(layout)
    image = Image.open(io.BytesIO(data))
    shown = Image.alpha_composite(Image.new("RGBA", image.size, "white"), image.convert("RGBA")).convert("RGB")
    assert np.abs(decode_rgb(data, Limits()).astype(int) - np.asarray(shown)).max() <= 2


def _tiff16(layout: str) -> bytes:
    """An uncompressed TIFF of 16 bits a channel."""
    alpha = np.linspace(0.2, 1, 96)[None, :, None] * np.ones((48, 1, 1))
    pixels = RGB / 255
    if "premultiplied" in layout:
        pixels = np.concatenate([pixels * alpha, alpha], 2)
    if layout == "CMYK":
        pixels = np.concatenate([1 - pixels, np.zeros((48, 96, 1))], 2)
    values = np.rint(pixels * 65535).astype("<u2")
    channels, planes = values.shape[2], "planes" in layout
    stored = [np.ascontiguousarray(values[..., c]).tobytes() for c in range(channels)] if planes else [values.tobytes()]
    starts = np.cumsum([8, *(len(each) for each in stored)])
    kind, arrangement = (5 if layout == "CMYK" else 2), (2 if planes else 1)
    tags: dict[int, tuple[int, ...]] = {
        256: (96,), 257: (48,), 258: (16,) * channels, 259: (1,), 262: (kind,), 273: tuple(starts[:-1]),
        277: (channels,), 278: (48,), 279: tuple(len(each) for each in stored), 284: (arrangement,),
    }  # fmt: skip
    if "premultiplied" in layout:
        tags[338] = (1,)
    table, extra = struct.pack("<H", len(tags)), b""
    after = int(starts[-1]) + 2 + 12 * len(tags) + 4
    for tag, given in tags.items():
        packed = struct.pack(f"<{len(given)}I", *given)
        table += struct.pack("<HHI", tag, 4, len(given))
        table += packed if len(given) == 1 else struct.pack("<I", after + len(extra))
        extra += packed if len(given) > 1 else b""
    return b"II*\0" + struct.pack("<I", starts[-1]) + b"".join(stored) + table + bytes(4) + extra


def test_a_transparent_value_of_one_bit(tmp_path: Path) -> None:
    image = Image.fromarray(RGB[..., 0] > 128)
    out = io.BytesIO()
    image.save(out, "PNG", transparency=0)
    raw = decode_raw(out.getvalue(), Limits())
    np.testing.assert_array_equal(raw[..., 3] == 255, RGB[..., 0] > 128)
    assert (decode_rgb(out.getvalue(), Limits()) == 255).all()


def test_a_16_bit_png_of_numbers_keeps_them() -> None:
    numbers = np.arange(48 * 96, dtype=np.uint16).reshape(48, 96) * 13
    np.testing.assert_array_equal(decode_raw(encoded(Image.fromarray(numbers), "PNG"), Limits()), numbers)


def test_a_colour_profile_is_converted_and_srgb_left_alone() -> None:
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert (decode_rgb(encoded(COLOUR, "PNG", icc_profile=srgb), Limits()) == RGB).all()
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    data = encoded(COLOUR, "PNG", icc_profile=lab)  # of another colour space than the picture: not applied
    assert (decode_rgb(data, Limits()) == RGB).all()
    notes = image_format(data).notes(encoded(COLOUR, "PNG", icc_profile=b"no profile" * 20))  # type: ignore[union-attr]
    assert notes == ("The colour profile cannot be read and is ignored.",)


def _motion_photo(extra: bytes) -> bytes:
    return encoded(COLOUR, "JPEG", quality=90) + extra


@pytest.mark.parametrize(
    ("data", "extra"),
    [
        (_motion_photo(b"\0\0\0\x18ftypmp42" + bytes(200_000)), 200_012),
        (_motion_photo(b"\xff\xd9" * 40), 80),
        (encoded(COLOUR, "PNG") + b"PK\x03\x04" + bytes(5000), 5004),
    ],
)
def test_data_behind_a_picture_is_mentioned(data: bytes, extra: int, tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(data)
    assert f"{extra} bytes follow the picture" in " ".join(probe(path).notes)


@pytest.mark.parametrize("kind", ["jpeg", "png", "webp turned with alpha", "avif", "tiff lzw", "bmp", "jpeg 2000"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_cut_still_is_refused(kind: str, share: float, tmp_path: Path) -> None:
    data = KINDS[kind]
    with pytest.raises(UnreadableMedia) as caught:
        decode_rgb(data[: int(share * len(data))], Limits(), "frame 7")
    assert caught.value.remedy


def test_a_cut_jpeg_with_a_whole_thumbnail_is_refused() -> None:
    thumbnail = encoded(COLOUR.resize((32, 16)), "JPEG")
    body = b"Exif\0\0MM\0*\0\0\0\x08\0\0\0\0\0\x0e\0\0\0\0" + thumbnail
    whole = encoded(COLOUR, "JPEG")
    data = whole[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2) + body + whole[2:]
    assert decode_rgb(data, Limits()).shape == (48, 96, 3)
    with pytest.raises(UnreadableMedia):
        decode_rgb(data[: len(data) - len(whole) // 3], Limits())


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_sizes_are_refused_before_pixels_are_decoded(kind: str) -> None:
    with pytest.raises(MediaTooLarge):
        decode_rgb(KINDS[kind], Limits(pixels=1000))


# -- animations


def _moving(count: int = 5) -> list[Image.Image]:
    return [Image.fromarray(np.roll(RGB, 8 * index, 1)) for index in range(count)]


@pytest.mark.parametrize("form", ["GIF", "PNG", "WEBP", "AVIF"])
def test_an_animation_is_a_video_with_its_own_times(form: str, tmp_path: Path) -> None:
    first, *rest = _moving()
    path = tmp_path / "upload"
    times = [40, 80, 120, 40, 200]
    options: dict[str, Any] = {"lossless": True} if form == "WEBP" else {}
    first.save(path, form, save_all=True, append_images=rest, duration=times, loop=0, **options)
    info = probe(path)
    assert (info.kind, info.frames, info.duration_s) == ("video", 5, pytest.approx(0.48))
    with VideoReader(path) as reader:
        assert list(reader.timestamps) == [0, 40, 120, 240, 280]
        frames = list(reader.read())
        again = next(reader.read(1, 2))
        image = Image.open(path)
        for index, frame in enumerate(frames):
            image.seek(index)
            assert np.abs(frame - np.asarray(image.convert("RGB"), np.int16)).max() <= 2
    np.testing.assert_array_equal(again, frames[1])


def test_an_animation_of_palettes_is_the_same_when_read_again(tmp_path: Path) -> None:
    path = tmp_path / "upload"
    first, *rest = (each.quantize(16) for each in _moving())
    first.save(path, "PNG", save_all=True, append_images=rest, duration=40)
    with VideoReader(path) as reader:
        frames = list(reader.read())
        assert np.abs(frames[0].astype(int) - np.asarray(first.convert("RGB"))).max() <= 2
        for start in (3, 1, 0):
            np.testing.assert_array_equal(next(reader.read(start, start + 1)), frames[start])


def test_a_default_picture_is_no_frame_of_an_animation(tmp_path: Path) -> None:
    path = tmp_path / "upload"
    first, *rest = _moving()
    first.save(path, "PNG", save_all=True, append_images=rest, duration=40, default_image=True)
    with VideoReader(path) as reader:
        frames = list(reader.read())
    assert len(frames) == len(rest) and np.abs(frames[0].astype(int) - np.asarray(rest[0])).max() <= 2


@pytest.mark.parametrize("size", [(96, 30), (60, 48), (60, 30)])
def test_pictures_of_a_gif_beyond_its_screen_are_cut(size: tuple[int, int], tmp_path: Path) -> None:
    path, parts = tmp_path / "upload", []
    for each in (COLOUR.crop((0, 0, *size)), COLOUR):
        each.save(path, "GIF")
        parts.append(path.read_bytes())
    colours = 3 << (parts[1][10] & 7) + 1
    path.write_bytes(parts[0][:-1] + parts[1][13 + colours :])
    with VideoReader(path) as reader:
        assert [frame.shape[1::-1] for frame in reader.read()] == [size, size]


@pytest.mark.parametrize("case", ["animated-gif:561:33", "animated-gif:561:403", "gif:561:389", "animated-gif:561:140"])
def test_errors_of_the_decoder_refuse_a_damaged_animation(case: str, tmp_path: Path) -> None:
    """Cases of `tests.fuzz`."""
    found = media.outcome(media.Case.of(f"media:{case}"), tmp_path)
    assert not found.startswith("fault"), found


@pytest.mark.parametrize("form", ["GIF", "PNG"])
def test_a_cut_animation_shows_the_frame_before_and_says_so(form: str, tmp_path: Path) -> None:
    first, *rest = _moving()
    path = tmp_path / "upload"
    first.save(path, form, save_all=True, append_images=rest, duration=40)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * 0.75)])
    info = probe(path)
    assert "unreadable" in info.damage and 2 <= info.frames <= 5
    with VideoReader(path) as reader:
        *_, before, last = reader.read()
        assert reader.unreadable == [info.frames - 1]
    np.testing.assert_array_equal(before, last)


def test_heic_is_the_whole_picture_turned(tmp_path: Path) -> None:
    path = tmp_path / "photo.mov"  # told by its contents, not by its name
    COLOUR.resize((640, 320)).save(path, "HEIF", quality=90, exif=TURNED)
    info = probe(path)
    assert (info.media_type, info.kind, {info.width, info.height}) == ("image/heif", "image", {320, 640})


def _dpx(pixel_format: str) -> bytes:
    import av

    frame = av.VideoFrame.from_ndarray(RGB, format="rgb24").reformat(format=pixel_format)
    context = av.CodecContext.create("dpx", "w")
    context.width, context.height, context.pix_fmt = 96, 48, pixel_format  # type: ignore[attr-defined]
    context.time_base = Fraction(1, 24)
    return b"".join(bytes(packet) for packet in context.encode(frame))  # type: ignore[attr-defined]


def test_dpx_of_ten_bits() -> None:
    assert np.abs(decode_rgb(_dpx("gbrp10le"), Limits()).astype(int) - RGB).max() <= 2


@pytest.mark.parametrize(("aspect", "size"), [((2, 1), (192, 48)), ((1, 2), (96, 96)), ((0xFFFFFFFF,) * 2, (96, 48))])
def test_pixels_of_dpx_become_square(aspect: tuple[int, int], size: tuple[int, int]) -> None:
    data = _dpx("rgb24")
    order = ">" if data[:4] == b"SDPX" else "<"
    data = data[:1628] + struct.pack(f"{order}II", *aspect) + data[1636:]
    assert decode_rgb(data, Limits()).shape[1::-1] == size
    assert any("aspect" in note for note in DPX.notes(data)) == (size != (96, 48))
