"""Media type of a file from its first bytes (never from its name), and image size without decoding.

Decoders allocate the size that a header claims, so this module reads and checks sizes before any decoder runs.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import BinaryIO

from pipeline.video.media import unreadable

IMAGE_TYPES = ("image/png", "image/jpeg", "image/webp", "image/tiff", "image/bmp", "image/x-exr")
_MAGIC = (
    (b"\x76\x2f\x31\x01", "image/x-exr"),
    (b"\x89PNG\r\n\x1a\n", "image/png"),
    (b"\xff\xd8\xff", "image/jpeg"),
    (b"II*\x00", "image/tiff"),
    (b"MM\x00*", "image/tiff"),
    (b"BM", "image/bmp"),
    (b"PK\x03\x04", "application/zip"),
    (b"PK\x05\x06", "application/zip"),
    (b"GIF8", "image/gif"),
    (b"\x1aE\xdf\xa3", "video/x-matroska"),
)
_PROGRAMS = (b"MZ", b"\x7fELF", b"#!", b"\xca\xfe\xba\xbe", b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xfe\xed\xfa")
_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_BARE_MARKERS = frozenset({0x01, *range(0xD0, 0xD9)})


@dataclass(frozen=True)
class ImageHeader:
    media_type: str
    width: int
    height: int
    animated: bool = False
    """Whether the file may contain more than one picture; such a PNG or GIF is read as a video."""


def sniff(stream: BinaryIO) -> str:
    """Detect the media type: an image type, zip, JSON, GIF, Matroska, AVI or MP4; "" = unknown, try the demuxers.

    Raises:
        UnreadableMedia: the file is a program, or text that is not JSON.
    """
    head = stream.read(4096)
    stream.seek(0)
    for magic, media_type in _MAGIC:
        if head.startswith(magic):
            return _webm(head) if media_type == "video/x-matroska" else media_type
    if head[:4] == b"RIFF":
        return {b"WEBP": "image/webp", b"AVI ": "video/x-msvideo"}.get(head[8:12], "")
    if head[4:8] == b"ftyp":
        return "video/quicktime" if head[8:12] == b"qt  " else "video/mp4"
    return _text_or_program(head)


def _webm(head: bytes) -> str:
    return "video/webm" if b"webm" in head[:64] else "video/x-matroska"


def _text_or_program(head: bytes) -> str:
    if head.startswith(_PROGRAMS):
        unreadable("The file is a program, not media.", repr(head[:4]))
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:1] in (b"{", b"["):
        return "application/json"
    if not head.startswith(b"YUV4MPEG2") and _is_text(head):
        unreadable("The file is text, not media.")  # its content is not quoted: it may be private
    return ""


def _is_text(head: bytes) -> bool:
    try:
        head[:1024].decode("utf-8")
    except UnicodeDecodeError as error:
        return error.start > 1000 and b"\0" not in head
    return b"\0" not in head


def image_header(stream: BinaryIO, media_type: str) -> ImageHeader:
    """Read the header of a GIF or of an image of one of `IMAGE_TYPES`. Sizes are as stored, before EXIF rotation, px.

    Raises:
        UnreadableMedia: the header is truncated or invalid.
    """
    try:
        width, height, animated = _PARSERS[media_type](stream)
    except (struct.error, IndexError, ValueError) as error:
        unreadable("The image's header is cut off or damaged.", f"{media_type}: {error}", "Export the image again.")
    return ImageHeader(media_type, width, height, animated)


def is_still(header: ImageHeader) -> bool:
    """Whether the file is read as one picture. Animated PNG and GIF are videos; an animated WebP yields one picture."""
    return not (header.animated and header.media_type in ("image/png", "image/gif"))


def _png(stream: BinaryIO) -> tuple[int, int, bool]:
    head = stream.read(1 << 16)
    if head[12:16] != b"IHDR":
        raise ValueError("no IHDR")
    width, height = struct.unpack_from(">II", head, 16)
    data_at = head.find(b"IDAT")
    return width, height, 0 < head.find(b"acTL") < (data_at if data_at > 0 else len(head))


def _jpeg(stream: BinaryIO) -> tuple[int, int, bool]:
    stream.seek(2)
    while True:
        if stream.read(1) != b"\xff":
            raise ValueError("no frame header")
        marker = stream.read(1)[0]
        while marker == 0xFF:
            marker = stream.read(1)[0]
        if marker in _BARE_MARKERS:
            continue
        (length,) = struct.unpack(">H", stream.read(2))
        if marker in _FRAME_MARKERS:
            height, width = struct.unpack(">xHH", stream.read(5))
            return width, height, False
        stream.seek(length - 2, 1)


def _webp(stream: BinaryIO) -> tuple[int, int, bool]:
    head = stream.read(32)
    kind = head[12:16]
    if kind == b"VP8X":
        width = int.from_bytes(head[24:27], "little") + 1
        return width, int.from_bytes(head[27:30], "little") + 1, bool(head[20] & 2)
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", head, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1, False
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", head, 26)
        return width & 0x3FFF, height & 0x3FFF, False
    raise ValueError("no VP8 chunk")


def _tiff(stream: BinaryIO) -> tuple[int, int, bool]:
    order = "<" if stream.read(2) == b"II" else ">"
    (offset,) = struct.unpack(order + "xxI", stream.read(6))
    stream.seek(offset)
    (count,) = struct.unpack(order + "H", stream.read(2))
    found: dict[int, int] = {}
    for _ in range(count):
        tag, kind, _n, value = struct.unpack(order + "HHI4s", stream.read(12))
        found[tag] = struct.unpack(order + ("H" if kind == 3 else "I"), value[: 2 if kind == 3 else 4])[0]
    if not {256, 257} <= found.keys():
        raise ValueError("no size")
    return found[256], found[257], False


def _bmp(stream: BinaryIO) -> tuple[int, int, bool]:
    width, height = struct.unpack("<18xii", stream.read(26))
    return abs(width), abs(height), False


def _gif(stream: BinaryIO) -> tuple[int, int, bool]:
    width, height = struct.unpack("<6xHH", stream.read(10))
    return width, height, True


_EXR_WINDOW = b"displayWindow\0box2i\0\x10\0\0\0"


def _exr(stream: BinaryIO) -> tuple[int, int, bool]:
    head = stream.read(1 << 20)
    at = head.find(_EXR_WINDOW)
    if at < 0:
        raise ValueError("no display window")
    left, top, right, bottom = struct.unpack_from("<4i", head, at + len(_EXR_WINDOW))
    return right - left + 1, bottom - top + 1, False


_PARSERS = {
    "image/gif": _gif,
    "image/x-exr": _exr,
    "image/png": _png,
    "image/jpeg": _jpeg,
    "image/webp": _webp,
    "image/tiff": _tiff,
    "image/bmp": _bmp,
}
