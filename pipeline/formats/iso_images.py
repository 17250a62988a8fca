"""AVIF and HEIF (HEIC): images in ISO base media files, told from videos by the brands in their first box."""

from __future__ import annotations

import struct

import pillow_heif

from pipeline.formats.base import Carries
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
