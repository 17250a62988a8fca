"""TIFF and BigTIFF by Pillow; colours of more than 8 bits a channel, which Pillow reduces or refuses, by OpenCV."""

from __future__ import annotations

import io
from dataclasses import dataclass
from fractions import Fraction
from typing import BinaryIO

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext
from PIL import ExifTags, TiffImagePlugin

from pipeline.arrays import AnyArray
from pipeline.formats.base import Carries, Choice, ImageHeader, OutputFormat, Profile
from pipeline.formats.pillow import PillowFormat, faults
from pipeline.video.depth import as_uint8, as_uint16
from pipeline.video.media import Limits, check_window, unreadable

_TAG = ExifTags.Base
_RGB, _PREMULTIPLIED = 2, 1
_TURNED = (5, 6, 7, 8)
"""Orientations that exchange width and height."""


class Tiff(PillowFormat):
    name, title, media_type, plugin = "tiff", "TIFF", "image/tiff", "TIFF"
    suffixes = (".tif", ".tiff")
    magic = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
    carries = Carries(alpha=True, depth_bits=32)

    def header(self, stream: BinaryIO) -> ImageHeader:
        facts = _facts(stream)
        return ImageHeader(self.media_type, *(facts.size[::-1] if facts.orientation in _TURNED else facts.size))

    def notes(self, data: bytes, choice: Choice = Choice()) -> tuple[str, ...]:
        return () if _facts(io.BytesIO(data)).is_deep else super().notes(data, choice)

    def read(self, data: bytes, limits: Limits, name: str, choice: Choice = Choice()) -> AnyArray:
        facts = _facts(io.BytesIO(data))
        if not facts.is_deep:
            return super().read(data, limits, name, choice)
        check_window(*facts.size, limits, name)
        with faults("The image cannot be decoded", name):
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if stored is None or stored.ndim != 3 or stored.dtype not in (np.uint16, np.float32, np.float64):
            unreadable("This kind of TIFF is not read.", name, "Export it as 8 or 16 bit RGB.")
        code = cv2.COLOR_BGRA2RGBA if stored.shape[2] == 4 else cv2.COLOR_BGR2RGB
        pixels = stored if stored.dtype == np.uint16 else stored.astype(np.float32)
        return _turned(np.asarray(cv2.cvtColor(pixels, code)), facts.orientation)


TIFF = Tiff()


@dataclass(frozen=True)
class _Facts:
    """Facts of the first picture. `is_deep`: it has RGB colours of more than 8 bits a channel, in a layout that OpenCV
    reads right: channels side by side, opacity (if any) apart from the colours."""

    size: tuple[int, int]
    orientation: int
    is_deep: bool


def _facts(stream: BinaryIO) -> _Facts:
    stream.seek(0)
    with faults("The image's header cannot be read", "image"):
        head = stream.read(8)
        tags = TiffImagePlugin.ImageFileDirectory_v2(head + (stream.read(8) if head[2:3] == b"+" else b""))
        stream.seek(tags.next)
        tags.load(stream)
        size = int(tags[_TAG.ImageWidth]), int(tags[_TAG.ImageLength])
        deep = max(tags.get(_TAG.BitsPerSample, (1,))) > 8 and tags.get(_TAG.PhotometricInterpretation) == _RGB
        apart = tags.get(_TAG.PlanarConfiguration, 1) == 1 and _PREMULTIPLIED not in tags.get(_TAG.ExtraSamples, ())
        facts = _Facts(size, int(tags.get(_TAG.Orientation, 1)), deep and apart)
    stream.seek(0)
    return facts


def _turned(pixels: AnyArray, orientation: int) -> AnyArray:
    if orientation in _TURNED:
        pixels = np.swapaxes(pixels, 0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def encode_tiff(picture: AnyArray) -> bytes:
    """Encode a picture, uint8 or uint16 (h, w, 3 or 4), as TIFF with Deflate compression. FFmpeg's encoder, because
    OpenCV's does not mark the fourth channel as opacity."""
    layout = {(1, 3): "rgb24", (1, 4): "rgba", (2, 3): "rgb48le", (2, 4): "rgba64le"}
    frame = av.VideoFrame.from_ndarray(picture, format=layout[picture.itemsize, picture.shape[2]])
    context = av.CodecContext.create("tiff", "w")
    assert isinstance(context, VideoCodecContext)
    context.width, context.height, context.pix_fmt = frame.width, frame.height, frame.format.name
    context.time_base, frame.pts = Fraction(1, 25), 0
    context.options = {"compression_algo": "deflate", "flags": "+bitexact"}
    context.thread_count = 1
    return b"".join(bytes(packet) for packet in (*context.encode(frame), *context.encode(None)))


TIFF_FRAMES = OutputFormat(
    name="tiff", title="TIFF frames", help="The film's frames as 16-bit pictures, in a zip",
    media_type="application/zip", suffixes=(), frame_suffixes=(".tif", ".tiff"), shown_as="sheet",
    profiles=(
        Profile(
            name="16", title="16 bit", depth_bits=16, has_quality=False, low_bytes_per_pixel=0.6, bytes_per_pixel=4,
            encode=lambda picture, _: encode_tiff(as_uint16(picture)),
        ),
        Profile(
            name="8", title="8 bit", has_quality=False, low_bytes_per_pixel=0.3, bytes_per_pixel=2,
            encode=lambda picture, _: encode_tiff(as_uint8(picture)),
        ),
    ),
)  # fmt: skip
