"""Windows bitmaps."""

from __future__ import annotations

from pipeline.formats.base import Carries
from pipeline.formats.pillow import PillowFormat


class Bmp(PillowFormat):
    name, title, media_type, plugin = "bmp", "BMP", "image/bmp", "BMP"
    suffixes = (".bmp", ".dib")
    magic = (b"BM",)
    carries = Carries(alpha=True, metadata=False)


BMP = Bmp()
