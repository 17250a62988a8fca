"""WebM with VP9 and Opus."""

from __future__ import annotations

from pipeline.formats.base import Carries, OutputFormat
from pipeline.formats.mp4 import KEY_EVERY

_SPEED = {
    "deadline": "realtime", "cpu-used": "8", "tile-columns": "2", "lag-in-frames": "0", "auto-alt-ref": "0",
    "row-mt": "0",
}  # fmt: skip


def _options(quality: int) -> dict[str, str]:
    lossless = {"lossless": "1"} if quality == 0 else {}
    return {"crf": str(round(quality * 63 / 51)), "b": "0", "g": str(KEY_EVERY)} | _SPEED | lossless


WEBM = OutputFormat(
    name="webm", title="WebM", help="Free of patents", media_type="video/webm", suffixes=(".webm",),
    carries=Carries(animation=True, sound=True), container="webm", segment_container="mp4", codec="libvpx-vp9",
    codec_options=_options,
)  # fmt: skip
