"""PNG and animated PNG; films as zips or folders of numbered PNG frames."""

from __future__ import annotations

from pipeline.arrays import AnyArray
from pipeline.formats.base import Carries, OutputFormat, Profile
from pipeline.formats.pillow import PillowFormat
from pipeline.video.depth import as_uint8, as_uint16
from pipeline.video.stills import encode_png


class Png(PillowFormat):
    name, title, media_type, plugin = "png", "PNG", "image/png", "PNG"
    suffixes = (".png", ".apng")
    magic = (b"\x89PNG\r\n\x1a\n",)
    carries = Carries(alpha=True, depth_bits=16, animation=True)

    def end_of(self, data: bytes) -> int:
        at = 8
        while at + 8 <= len(data):
            kind, at = data[at + 4 : at + 8], at + 12 + int.from_bytes(data[at : at + 4])
            if kind == b"IEND":
                return at
        return len(data)


PNG = Png()


def _sixteen_bit(picture: AnyArray) -> bytes:
    return encode_png(as_uint16(picture))


PNG_FRAMES = OutputFormat(
    name="png", title="PNG frames", help="The film's frames as lossless pictures, in a zip",
    media_type="application/zip", suffixes=(".zip",), frame_suffixes=(".png",), shown_as="sheet",
    profiles=(
        Profile(
            name="8", title="8 bit", has_quality=False, low_bytes_per_pixel=0.3, bytes_per_pixel=1.5,
            encode=lambda picture: encode_png(as_uint8(picture)),
        ),
        Profile(
            name="16", title="16 bit", depth_bits=16, has_quality=False, low_bytes_per_pixel=0.6, bytes_per_pixel=4,
            encode=_sixteen_bit,
        ),
    ),
)  # fmt: skip
