"""MP4, by default with H.264 in 4:2:0, the only variant that all browsers play, and AAC."""

from __future__ import annotations

from pipeline.formats.base import OutputFormat, SoundCodecs
from pipeline.formats.codecs import AV1, H264, H264_444, HEVC

MP4 = OutputFormat(
    name="mp4", title="MP4", help="Plays everywhere", media_type="video/mp4", suffixes=(".mp4", ".m4v"),
    profiles=(H264, H264_444, HEVC, AV1), container="mp4", mux_options={"movflags": "+faststart"},
    sound=SoundCodecs(copied=frozenset({"aac", "mp3"}), encoder="aac"), subtitles=frozenset({"mov_text"}),
    timecode=True,
)  # fmt: skip
