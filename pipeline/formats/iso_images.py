"""AVIF and HEIF (HEIC): images in ISO base media files, told from videos by the brands in their first box."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pillow_heif

from pipeline.formats.animations import animated, joined_by
from pipeline.formats.base import Carries, OutputFormat, Progress, Segments
from pipeline.formats.pillow import PillowFormat

pillow_heif.register_heif_opener(thumbnails=False)


def _brands(head: bytes) -> list[bytes]:
    """Brands of an ISO base media file, the major one first; empty for other files."""
    if head[4:8] != b"ftyp":
        return []
    (size,) = struct.unpack_from(">I", head)
    return [head[8:12], *(head[at : at + 4] for at in range(16, min(size, len(head)) - 3, 4))]


class IsoImage(PillowFormat):
    """
    Attributes:
        brands: brands of which one must be among a file's.
    """

    brands: tuple[bytes, ...]

    def sniff(self, head: bytes) -> bool:
        found = _brands(head)
        return bool(found) and found[0] in (*self.brands, b"mif1", b"msf1") and any(b in self.brands for b in found)


class Avif(IsoImage):
    name, title, media_type, plugin = "avif", "AVIF", "image/avif", "AVIF"
    suffixes = (".avif", ".avifs")
    brands = (b"avif", b"avis")
    carries = Carries(alpha=True, depth_bits=12, animation=True)


class Heif(IsoImage):
    """HEIC photos. libheif assembles pictures from tiles, and turns them."""

    name, title, media_type, plugin = "heif", "HEIC", "image/heif", "HEIF"
    suffixes = (".heic", ".heif", ".hif")
    brands = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx")
    carries = Carries(alpha=True, depth_bits=12)


AVIF, HEIF = Avif(), Heif()


def _options(quality: int) -> dict[str, Any]:
    """Arguments of Pillow's encoder. Quality 0 differs by a few levels, because AV1 stores YCbCr."""
    return {
        "quality": round(100 - 1.6 * quality), "speed": 8, "max_threads": 2, "subsampling": "4:4:4", "range": "full"
    }  # fmt: skip


_write = joined_by("AVIF", _options)


def _join_avif(segments: Segments, out: Path, progress: Progress, quality: int) -> None:
    """Write an animation without the date that libavif puts into it, so that the same frames give the same bytes."""
    _write(segments, out, progress, quality)
    data = bytearray(out.read_bytes())
    start = data.find(b"moov")
    end = start + int.from_bytes(data[start - 4 : start]) if start >= 4 else 0
    for box in (b"mvhd", b"tkhd", b"mdhd"):
        at = start
        while (at := data.find(box, at + 4, end)) >= 0:
            times = at + 8  # after the box's type, version and flags
            data[times : times + (16 if data[at + 4] else 8)] = bytes(16 if data[at + 4] else 8)
    out.write_bytes(data)


AVIF_FILM = OutputFormat(
    name="avif", title="AVIF", help="Animated picture with opacity, without sound", media_type="image/avif",
    suffixes=(".avif",), profiles=(animated("avif", "AVIF", "8 bit 4:4:4 with opacity"),), shown_as="image",
    join=_join_avif,
)  # fmt: skip
