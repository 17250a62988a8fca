"""Further stills that Pillow reads: JPEG 2000, Photoshop (the flattened picture), Targa, PNM, ICO, PCX, SGI, QOI."""

from __future__ import annotations

from pipeline.formats.base import Carries
from pipeline.formats.pillow import PillowFormat


class Jpeg2000(PillowFormat):
    name, title, media_type, plugin = "jp2", "JPEG 2000", "image/jp2", "JPEG2000"
    suffixes = (".jp2", ".j2k", ".jpx")
    magic = (b"\0\0\0\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51")
    carries = Carries(alpha=True, depth_bits=16)


class Photoshop(PillowFormat):
    name, title, media_type, plugin = "psd", "Photoshop", "image/vnd.adobe.photoshop", "PSD"
    suffixes = (".psd",)
    magic = (b"8BPS",)


class Targa(PillowFormat):
    """Targa has no mark at its start: its header is recognised by fields that can have few values."""

    name, title, media_type, plugin = "tga", "Targa", "image/x-tga", "TGA"
    suffixes = (".tga",)
    carries = Carries(alpha=True, metadata=False)

    def sniff(self, head: bytes) -> bool:
        if len(head) < 18 or head[1] not in (0, 1) or head[16] not in (8, 15, 16, 24, 32) or head[17] & 0xC0:
            return False
        mapped = head[2] in (1, 9)
        kind = mapped if head[1] else head[2] in (2, 3, 10, 11) and not any(head[3:8])
        return kind and any(head[12:14]) and any(head[14:16])


class Pnm(PillowFormat):
    name, title, media_type, plugin = "pnm", "PNM", "image/x-portable-anymap", "PPM"
    suffixes = (".ppm", ".pgm", ".pbm", ".pnm")
    magic = tuple(b"P%d%c" % (kind, space) for kind in range(1, 7) for space in b" \n\r\t")
    carries = Carries(depth_bits=16, metadata=False)


class Icon(PillowFormat):
    name, title, media_type, plugin = "ico", "ICO", "image/x-icon", "ICO"
    suffixes = (".ico",)
    magic = (b"\0\0\1\0",)
    carries = Carries(alpha=True, metadata=False)


class Pcx(PillowFormat):
    name, title, media_type, plugin = "pcx", "PCX", "image/x-pcx", "PCX"
    suffixes = (".pcx",)
    carries = Carries(metadata=False)

    def sniff(self, head: bytes) -> bool:
        versions, depths = (0, 2, 3, 4, 5), (1, 2, 4, 8)
        return len(head) >= 128 and head[0] == 10 and head[1] in versions and head[2] == 1 and head[3] in depths


class Sgi(PillowFormat):
    name, title, media_type, plugin = "sgi", "SGI", "image/sgi", "SGI"
    suffixes = (".sgi", ".rgb", ".rgba", ".bw")
    magic = (b"\x01\xda\0\x01", b"\x01\xda\x01\x01", b"\x01\xda\0\x02", b"\x01\xda\x01\x02")
    carries = Carries(alpha=True, metadata=False)


class Qoi(PillowFormat):
    name, title, media_type, plugin = "qoi", "QOI", "image/qoi", "QOI"
    suffixes = (".qoi",)
    magic = (b"qoif",)
    carries = Carries(alpha=True, metadata=False)


RARE = (Jpeg2000(), Photoshop(), Targa(), Pnm(), Icon(), Pcx(), Sgi(), Qoi())
