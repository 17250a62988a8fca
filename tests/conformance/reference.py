"""What FFmpeg (through PyAV), Pillow or OpenEXR find in a file."""

from __future__ import annotations

import io
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
import numpy as np
import OpenEXR
from av.container import InputContainer
from numpy.typing import NDArray
from PIL import Image, ImageCms, ImageOps

from pipeline.formats import IMAGE_SUFFIXES
from tests.conformance.facts import MOST_PICTURES, Colours, Facts, most_pictures, onset

STILLS = IMAGE_SUFFIXES - {".exr", ".dpx"} | {".apng"}
_MOST_S = 30.0
"""Sound after this time is not looked at."""


def by_library(path: Path) -> Facts:
    """Read a file with the library for its kind."""
    try:
        if path.suffix.lower() == ".exr":
            return _exr(path)
        return _still(path) if path.suffix.lower() in STILLS else _film(path)
    except Exception as error:  # whatever a library raises for a file that it cannot read
        return Facts(refused=f"{type(error).__name__}: {error}"[:200])


def _exr(path: Path) -> Facts:
    with OpenEXR.File(str(path), header_only=True) as file:
        header = file.header()
        (left, top), (right, bottom) = header["displayWindow"]
        width, height = int(right - left + 1), int(bottom - top + 1)
        aspect = float(header.get("pixelAspectRatio", 1.0))
        deep = all(part.header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile) for part in file.parts)
    if deep:
        return Facts(refused="deep pixels")
    found, colours = Facts(1, [0.0], _square(width, height, Fraction(aspect).limit_denominator(1000))), Colours()
    with OpenEXR.File(str(path)) as file:
        planes = {name: channel.pixels for name, channel in file.channels().items()}
    known = ("RGBA", "RGB") if "RY" in planes else ("RGBA", "RGB", "Y")
    pixels = next((planes[name] for name in known if name in planes), None)
    if pixels is not None and pixels.shape[:2] == (height, width):
        colours.add(_encoded(pixels))
        found.colours = colours.sampled()
    return found


def _encoded(linear: NDArray[Any]) -> NDArray[np.uint8]:
    """sRGB of linear light, premultiplied if it has opacity."""
    light = np.nan_to_num(np.atleast_3d(linear).astype(np.float64))
    clear = np.clip(light[..., 3:], 0, 1)
    shown = np.clip(light[..., :3] / np.maximum(clear, 1e-4) if light.shape[2] == 4 else light[..., :3], 0, 1)
    shown = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    shown = np.repeat(shown, 3 // shown.shape[2], 2)
    return np.asarray(np.rint(255 * np.concatenate([shown, clear], 2)), np.uint8)


def _still(path: Path) -> Facts:
    found, colours = Facts(), Colours()
    with Image.open(path) as image:
        count = min(getattr(image, "n_frames", 1), MOST_PICTURES)
        animated = getattr(image, "is_animated", False) and image.format in ("GIF", "PNG", "WEBP", "AVIF")
        first = int(animated and bool(image.info.get("default_image")))  # for programs that do not animate
        at = 0.0
        for number in range(first, count if animated else 1):
            if animated:
                image.seek(number)
            shown = ImageOps.exif_transpose(image)
            colours.add(_srgb(shown))
            found.times_s.append(at)
            shown_ms = float(image.info.get("duration", 0))
            at += (shown_ms if shown_ms >= 20 else 100) / 1000  # as browsers do
            found.size = found.size if found.times_s[1:] else shown.size
        found.pictures = len(found.times_s)
    found.colours = colours.sampled()
    return found


def _srgb(image: Image.Image) -> NDArray[Any]:
    """The picture converted by its profile, RGBA."""
    if image.mode[0] in "IF":
        scale = 1 / 256 if image.mode[0] == "I" else 255
        gray = np.clip(np.asarray(image, np.float64) * scale, 0, 255).astype(np.uint8)
        image = Image.fromarray(gray)
    profile = image.info.get("icc_profile")
    if profile and image.mode in ("RGB", "CMYK", "L", "P", "RGBA"):
        source = image if image.mode in ("RGB", "CMYK", "L") else image.convert("RGB")
        try:
            stored = ImageCms.ImageCmsProfile(io.BytesIO(profile))
            made = ImageCms.profileToProfile(source, stored, ImageCms.createProfile("sRGB"), outputMode="RGB")
        except ImageCms.PyCMSError:
            made = None
        if made is not None:
            if image.has_transparency_data:
                made.putalpha(image.convert("RGBA").getchannel("A"))
            image = made
    return np.asarray(image.convert("RGBA"))


def _film(path: Path) -> Facts:
    found, colours, most = Facts(), Colours(), most_pictures(path)
    with av.open(str(path), metadata_errors="replace") as source:
        stream: Any = source.streams.best("video")
        if stream is None or stream.disposition & stream.disposition.attached_pic:
            return Facts(refused="no video stream")
        stream.thread_type = "SLICE"  # threads for frames lose neighbours of a damaged one
        first_s, rate = None, stream.average_rate or stream.guessed_rate or 25
        for picture in islice(_decoded(source, stream, found), most):
            time = picture.pts if picture.pts is not None else picture.dts
            at = float(found.pictures / rate if time is None else time * picture.time_base)
            first_s = at if first_s is None else first_s
            found.times_s.append(at - first_s)
            found.size = found.size if found.pictures else _displayed(picture, stream.sample_aspect_ratio)
            found.damaged |= picture.is_corrupt
            colours.add(_pixels(picture))
            found.pictures += 1
    found.colours = colours.sampled()
    if not found.pictures:
        return Facts(refused="no picture can be decoded")
    found.onset_s = heard(path, first_s or 0.0)
    if path.suffix.lower() == ".avi" and found.pictures < most:  # FFmpeg's command fills empty places
        found.pictures = round(found.times_s[-1] * rate) + 1
        found.times_s = [float(at / rate) for at in range(found.pictures)]
    return found


def _decoded(source: InputContainer, stream: Any, found: Facts) -> Iterator[Any]:
    """Pictures or sound; packets that cannot be decoded are left out, as FFmpeg's command does."""
    packets = source.demux(stream)
    while True:
        try:
            if (packet := next(packets, None)) is None:
                return
            yield from packet.decode()
        except av.EOFError:
            return
        except (av.FFmpegError, ValueError) as error:
            found.damaged = True
            if not isinstance(error, av.InvalidDataError):
                return


def _pixels(picture: av.VideoFrame) -> NDArray[Any]:
    alpha = any(component.is_alpha for component in picture.format.components) or picture.format.name == "pal8"
    return picture.to_ndarray(format="rgba" if alpha else "rgb24")


def _displayed(picture: av.VideoFrame, aspect: Fraction | None) -> tuple[int, int]:
    width, height = _square(picture.width, picture.height, aspect)
    turned = picture.rotation in (90, -90, 270)  # a matrix that is no rotation gives a very low number
    return (height, width) if turned else (width, height)


def _square(width: int, height: int, aspect: Fraction | None) -> tuple[int, int]:
    if not aspect or abs(aspect - 1) < 0.005:
        return width, height
    return (2 * round(width * aspect / 2), height) if aspect > 1 else (width, 2 * round(height / aspect / 2))


def heard(path: Path, first_s: float) -> float | None:
    """The onset of a file's first sound track, seconds from `first_s`."""
    pieces: list[tuple[float, NDArray[Any], int]] = []
    with av.open(str(path), metadata_errors="replace") as source:
        stream = next((s for s in source.streams.audio if s.codec_context is not None), None)
        if stream is None:
            return None
        due_s = 0.0
        for piece in _decoded(source, stream, Facts()):
            at = due_s if piece.pts is None else float(piece.pts * piece.time_base) - first_s
            if at > _MOST_S:
                break
            pieces.append((at, _level(piece), piece.sample_rate))
            due_s = at + piece.samples / piece.sample_rate
    return onset(pieces)


def _level(piece: av.AudioFrame) -> NDArray[Any]:
    values = piece.to_ndarray()
    full = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1.0
    level = np.abs(values.astype(np.float64) - (128 if values.dtype == np.uint8 else 0)) / full
    return level.max(axis=0) if piece.format.is_planar else level.reshape(piece.samples, -1).max(axis=1)
