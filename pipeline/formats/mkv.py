"""Matroska: lossless FFV1, ProRes, H.264, HEVC and AV1, with lossless sound, for archives."""

from __future__ import annotations

from pipeline.formats.base import OutputFormat, SoundCodecs
from pipeline.formats.codecs import AV1, FFV1, H264, H264_444, HEVC, PRORES_4444, PRORES_HQ, in_segments

MKV = OutputFormat(
    name="mkv", title="Matroska", help="For archives: lossless FFV1", media_type="video/x-matroska",
    suffixes=(".mkv",),
    profiles=(*FFV1, PRORES_HQ, PRORES_4444, *(in_segments(each, "mp4") for each in (H264, H264_444, HEVC, AV1))),
    shown_as="sheet", container="matroska",
    sound=SoundCodecs(copied=frozenset({"flac", "pcm_s16le", "pcm_s24le"}), encoder="flac", sample_format="s32"),
    subtitles=frozenset({"ass", "subrip", "webvtt", "hdmv_pgs_subtitle", "dvd_subtitle"}), timecode=True,
)  # fmt: skip
