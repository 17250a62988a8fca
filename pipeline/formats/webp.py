"""WebP, still and animated, with opacity."""

from __future__ import annotations

from typing import Any

from pipeline.formats.animations import animated, joined_by
from pipeline.formats.base import Carries, OutputFormat
from pipeline.formats.pillow import PillowFormat


class WebP(PillowFormat):
    name, title, media_type, plugin = "webp", "WebP", "image/webp", "WEBP"
    suffixes = (".webp",)
    carries = Carries(alpha=True, animation=True)

    def sniff(self, head: bytes) -> bool:
        return head[:4] == b"RIFF" and head[8:12] == b"WEBP"


WEBP = WebP()


def _options(quality: int) -> dict[str, Any]:
    """Arguments of Pillow's encoder. Method 2 takes a third of the time of the default."""
    if quality == 0:
        return {"lossless": True, "quality": 30, "method": 2, "exact": True}
    return {"quality": round(100 - 1.6 * quality), "alpha_quality": 100, "method": 2}


WEBP_FILM = OutputFormat(
    name="webp", title="WebP", help="Animated picture with opacity, without sound", media_type="image/webp",
    suffixes=(".webp",), profiles=(animated("webp", "WebP", "8 bit with opacity"),), shown_as="image",
    join=joined_by("WEBP", _options),
)  # fmt: skip
