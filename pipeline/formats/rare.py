"""Further stills that Pillow reads: JPEG 2000, Photoshop (the flattened picture), Targa, PNM, ICO, PCX, SGI, QOI."""

from __future__ import annotations

from pipeline.formats.base import Carries
from pipeline.formats.pillow import PillowFormat

_PLAIN, _CLEAR = Carries(metadata=False), Carries(alpha=True, metadata=False)


class _Rare(PillowFormat):
    def __init__(self, name: str, title: str, plugin: str, suffixes: tuple[str, ...], magic: tuple[bytes, ...] = (),
                 carries: Carries = _CLEAR, media_type: str = "") -> None:  # fmt: skip
        self.name, self.title, self.plugin, self.suffixes, self.magic = name, title, plugin, suffixes, magic
        self.carries, self.media_type = carries, media_type or f"image/x-{name}"


class _Targa(_Rare):
    """Targa has no mark at its start: its header is recognised by fields that can have few values."""

    def sniff(self, head: bytes) -> bool:
        if len(head) < 18 or head[1] not in (0, 1) or head[16] not in (8, 15, 16, 24, 32) or head[17] & 0xC0:
            return False
        mapped = head[2] in (1, 9)
        kind = mapped if head[1] else head[2] in (2, 3, 10, 11) and not any(head[3:8])
        return kind and any(head[12:14]) and any(head[14:16])


class _Pcx(_Rare):
    def sniff(self, head: bytes) -> bool:
        versions, depths = (0, 2, 3, 4, 5), (1, 2, 4, 8)
        return len(head) >= 128 and head[0] == 10 and head[1] in versions and head[2] == 1 and head[3] in depths


RARE = (
    _Rare("jp2", "JPEG 2000", "JPEG2000", (".jp2", ".j2k", ".jpx"), (b"\0\0\0\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51"),
          Carries(alpha=True, depth_bits=16), "image/jp2"),
    _Rare("psd", "Photoshop", "PSD", (".psd",), (b"8BPS",), Carries(), "image/vnd.adobe.photoshop"),
    _Targa("tga", "Targa", "TGA", (".tga",)),
    _Rare("pnm", "PNM", "PPM", (".ppm", ".pgm", ".pbm", ".pnm"),
          tuple(b"P%d%c" % (kind, space) for kind in range(1, 7) for space in b" \n\r\t"),
          Carries(depth_bits=16, metadata=False), "image/x-portable-anymap"),
    _Rare("ico", "ICO", "ICO", (".ico",), (b"\0\0\1\0",), media_type="image/x-icon"),
    _Pcx("pcx", "PCX", "PCX", (".pcx",), carries=_PLAIN),
    _Rare("sgi", "SGI", "SGI", (".sgi", ".rgb", ".rgba", ".bw"),
          (b"\x01\xda\0\x01", b"\x01\xda\x01\x01", b"\x01\xda\0\x02", b"\x01\xda\x01\x02"), media_type="image/sgi"),
    _Rare("qoi", "QOI", "QOI", (".qoi",), (b"qoif",), media_type="image/qoi"),
)  # fmt: skip
