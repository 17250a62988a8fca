"""JPEG, also with several pictures (MPO) or a film behind the picture (motion photos)."""

from __future__ import annotations

from pipeline.formats.base import Carries
from pipeline.formats.pillow import PillowFormat


class Jpeg(PillowFormat):
    name, title, media_type, plugin = "jpeg", "JPEG", "image/jpeg", "JPEG"
    suffixes = (".jpg", ".jpeg", ".jpe", ".jfif")
    magic = (b"\xff\xd8\xff",)
    carries = Carries()

    def end_of(self, data: bytes) -> int:
        """After the end marker that follows the first scan: in a scan, the byte FF never precedes D9."""
        at = 2
        while data[at : at + 1] == b"\xff" and data[at + 1 : at + 2] != b"\xda":
            at += 2 + int.from_bytes(data[at + 2 : at + 4])
        end = data.find(b"\xff\xd9", at)
        return end + 2 if end >= 0 else len(data)


JPEG = Jpeg()
