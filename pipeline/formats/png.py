"""PNG and animated PNG; films as zips or folders of numbered PNG frames."""

from __future__ import annotations

from pipeline.formats.base import Carries, OutputFormat
from pipeline.formats.pillow import PillowFormat
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
PNG_FRAMES = OutputFormat(
    name="png", title="PNG frames", help="The film's frames as lossless pictures, in a zip",
    media_type="application/zip", suffixes=(".zip",), folder_suffix=".png", carries=Carries(metadata=False),
    has_quality=False, shown_as="sheet", low_bytes_per_pixel=0.3, bytes_per_pixel=1.5, encode=encode_png,
)  # fmt: skip
