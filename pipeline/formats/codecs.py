"""Profiles of codecs that several containers share. Same frames, same bytes: threads are fixed, dates are not written.

There are no B-frames, so that packets are in display order and segments can be joined without reordering.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2

from pipeline.formats.base import Profile, Quality

KEY_EVERY = 60
"""Most frames from one keyframe to the next."""
_CPU_AVX_512F = 13
"""`CV_CPU_AVX_512F` in the headers of OpenCV, which its Python module does not export."""
_X264_REPEATABLE_ASM = "MMX2,SSE2Fast,LZCNT,SSSE3,SSE4.2,AVX,FMA3,BMI2,AVX2"
"""CPU features that x264 may use on a processor with AVX-512. With its AVX-512 macroblock-tree code, the same frames of
96x64 gave different files in 3 to 15 % of the runs; without it they never did, at the same speed."""


def _x264(profile: str) -> Quality:
    def options(quality: int) -> dict[str, str]:
        tuning = {"x264-params": _x264_params(), "preset": "veryfast", "bf": "0"}
        return {"crf": str(quality), "g": str(KEY_EVERY)} | tuning | ({"profile": profile} if quality else {})

    return options


def _x264_params() -> str:
    """Settings of x264 that FFmpeg has no option for. The list of CPU features overrides x264's own detection, so it is
    given only to processors that have all of them: those with AVX-512."""
    limited = cv2.checkHardwareSupport(_CPU_AVX_512F)
    return f"sync-lookahead=0:asm={_X264_REPEATABLE_ASM}" if limited else "sync-lookahead=0"


def _x265(quality: int) -> dict[str, str]:
    fixed = "bframes=0:scenecut=0:open-gop=0:repeat-headers=0:info=0:pools=2:frame-threads=1:log-level=error"
    lossless = ":lossless=1" if quality == 0 else ""
    return {"crf": str(quality), "preset": "fast", "x265-params": f"keyint={KEY_EVERY}:{fixed}{lossless}"}


def _svtav1(quality: int) -> dict[str, str]:
    crf = str(max(1, round(quality * 63 / 51)))
    return {"crf": crf, "preset": "8", "g": str(KEY_EVERY), "svtav1-params": "pred-struct=1:lp=2"}


def _always(**options: str) -> Callable[[int], dict[str, str]]:
    return lambda quality: options


def _prores(name: str, title: str, number: int, tag: str, bytes_per_pixel: float) -> Profile:
    alpha = tag.startswith("ap4")
    options = {"profile": str(number), "vendor": "apl0"} | ({"alpha_bits": "16"} if alpha else {})
    return Profile(
        name=name, title=f"ProRes {title}", help="10 bit 4:4:4 with opacity" if alpha else "10 bit 4:2:2",
        depth_bits=10, has_quality=False, codec="prores_ks", tag=tag, codec_options=_always(**options),
        pixel_format="yuv444p10le" if alpha else "yuv422p10le", alpha_format="yuva444p10le" if alpha else "",
        segment_container="mov", low_bytes_per_pixel=0.05, bytes_per_pixel=bytes_per_pixel,
    )  # fmt: skip


def _dnxhr(name: str, title: str, help_text: str, pixel_format: str) -> Profile:
    return Profile(
        name=name, title=f"DNxHR {title}", help=help_text, depth_bits=10, has_quality=False, codec="dnxhd",
        codec_options=_always(profile=name.replace("-", "_")), pixel_format=pixel_format, even=True,
        always_709=True, min_size=(256, 120), segment_container="mov", low_bytes_per_pixel=0.3, bytes_per_pixel=1,
    )  # fmt: skip


def _ffv1(name: str, depth_bits: int, pixel_format: str, alpha_format: str) -> Profile:
    return Profile(
        name=name, title="FFV1", help=f"Lossless RGB of {depth_bits} bit, with opacity",
        depth_bits=depth_bits, has_quality=False, codec="ffv1", pixel_format=pixel_format, alpha_format=alpha_format,
        codec_options=_always(level="3", g="1", slices="4", slicecrc="1"), segment_container="mp4",
        low_bytes_per_pixel=0.1, bytes_per_pixel=depth_bits / 8,
    )  # fmt: skip


H264 = Profile(
    name="h264", title="H.264", help="8 bit 4:2:0, plays everywhere", codec="libx264", codec_options=_x264("high"),
    even=True,
)  # fmt: skip
H264_444 = Profile(
    name="h264-444", title="H.264 4:4:4", help="8 bit with full colour resolution, for programs rather than devices",
    codec="libx264", codec_options=_x264("high444"), pixel_format="yuv444p", bytes_per_pixel=0.08,
)  # fmt: skip
HEVC = Profile(
    name="hevc", title="HEVC", help="10 bit 4:2:0", depth_bits=10, codec="libx265", tag="hvc1",
    codec_options=_x265, pixel_format="yuv420p10le", even=True, segment_container="mp4",
)  # fmt: skip
AV1 = Profile(
    name="av1", title="AV1", help="10 bit 4:2:0", depth_bits=10, codec="libsvtav1", codec_options=_svtav1,
    pixel_format="yuv420p10le", even=True, min_size=(64, 64), segment_container="mp4",
)  # fmt: skip
PRORES_HQ = _prores("422hq", "422 HQ", 3, "apch", 0.9)
PRORES_4444 = _prores("4444", "4444", 4, "ap4h", 1.5)
PRORES = (
    PRORES_HQ, PRORES_4444, _prores("4444xq", "4444 XQ", 5, "ap4x", 2.2), _prores("422", "422", 2, "apcn", 0.6),
    _prores("422lt", "422 LT", 1, "apcs", 0.4), _prores("proxy", "Proxy", 0, "apco", 0.2),
)  # fmt: skip
DNXHR = (
    _dnxhr("dnxhr-hqx", "HQX", "10 bit 4:2:2", "yuv422p10le"),
    _dnxhr("dnxhr-444", "444", "10 bit 4:4:4", "yuv444p10le"),
)  # fmt: skip
FFV1 = (_ffv1("ffv1", 8, "bgr0", "bgra"), _ffv1("ffv1-16", 16, "gbrp16le", "gbrap16le"))


def in_segments(profile: Profile, container: str) -> Profile:
    """The profile with segments in another container."""
    return replace(profile, segment_container=container)
