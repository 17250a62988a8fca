"""QuickTime: ProRes, DNxHR, H.264 and HEVC, with uncompressed sound, for editing."""

from __future__ import annotations

from pipeline.formats.base import OutputFormat, SoundCodecs
from pipeline.formats.codecs import DNXHR, H264, H264_444, HEVC, PRORES

MOV = OutputFormat(
    name="mov", title="QuickTime", help="For editing: ProRes, DNxHR", media_type="video/quicktime", suffixes=(".mov",),
    profiles=(*PRORES, *DNXHR, H264, H264_444, HEVC), shown_as="sheet", container="mov",
    mux_options={"movflags": "+faststart"},
    sound=SoundCodecs(copied=frozenset({"pcm_s16le", "pcm_s24le"}), encoder="pcm_s24le"),
    subtitles=frozenset({"mov_text"}), timecode=True,
)  # fmt: skip
