"""WebM with VP9, with opacity if the film has one, and Opus."""

from __future__ import annotations

from pipeline.formats.base import OutputFormat, Profile, SoundCodecs
from pipeline.formats.codecs import AV1, KEY_EVERY

_SPEED = {
    "deadline": "realtime", "cpu-used": "8", "tile-columns": "2", "lag-in-frames": "0", "auto-alt-ref": "0",
    "row-mt": "0",
}  # fmt: skip


def _options(quality: int) -> dict[str, str]:
    lossless = {"lossless": "1"} if quality == 0 else {}
    return {"crf": str(round(quality * 63 / 51)), "b": "0", "g": str(KEY_EVERY)} | _SPEED | lossless


VP9 = Profile(
    name="vp9", title="VP9", help="8 bit 4:2:0 with opacity", codec="libvpx-vp9", codec_options=_options,
    alpha_format="yuva420p", segment_container="mp4", alpha_container="webm",
)  # fmt: skip
WEBM = OutputFormat(
    name="webm", title="WebM", help="Free of patents, with opacity", media_type="video/webm", suffixes=(".webm",),
    profiles=(VP9, AV1), container="webm",
    sound=SoundCodecs(copied=frozenset({"opus", "vorbis"}), encoder="libopus"), subtitles=frozenset({"webvtt"}),
)  # fmt: skip
