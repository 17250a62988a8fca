"""WebP, still and animated."""

from __future__ import annotations

from pipeline.formats.base import Carries
from pipeline.formats.pillow import PillowFormat


class WebP(PillowFormat):
    name, title, media_type, plugin = "webp", "WebP", "image/webp", "WEBP"
    suffixes = (".webp",)
    carries = Carries(alpha=True, animation=True)

    def sniff(self, head: bytes) -> bool:
        return head[:4] == b"RIFF" and head[8:12] == b"WEBP"


WEBP = WebP()
