"""MP4 with H.264 in 4:2:0, the only variant that all browsers play, and AAC."""

from __future__ import annotations

import cv2

from pipeline.formats.base import Carries, OutputFormat

KEY_EVERY = 60
"""Most frames from one keyframe to the next."""
_CPU_AVX_512F = 13
"""`CV_CPU_AVX_512F` in the headers of OpenCV, which its Python module does not export."""
_X264_REPEATABLE_ASM = "MMX2,SSE2Fast,LZCNT,SSSE3,SSE4.2,AVX,FMA3,BMI2,AVX2"
"""CPU features that x264 may use on a processor with AVX-512. Its AVX-512 macroblock-tree code is left out, because it
does not give the same file in each run."""


def _options(quality: int) -> dict[str, str]:
    tuning = {"x264-params": _x264_params(), "preset": "veryfast", "bf": "0"}
    profile = {"profile": "high"} if quality else {}
    return {"crf": str(quality), "g": str(KEY_EVERY)} | tuning | profile


def _x264_params() -> str:
    """Settings of x264 that FFmpeg has no option for. The list of CPU features overrides x264's own detection, so it is
    given only to processors that have all of them: those with AVX-512."""
    limited = cv2.checkHardwareSupport(_CPU_AVX_512F)
    return f"sync-lookahead=0:asm={_X264_REPEATABLE_ASM}" if limited else "sync-lookahead=0"


MP4 = OutputFormat(
    name="mp4", title="MP4", help="Plays everywhere", media_type="video/mp4", suffixes=(".mp4", ".m4v"),
    carries=Carries(animation=True, sound=True), container="mp4", codec="libx264", codec_options=_options,
    mux_options={"movflags": "+faststart"}, even=True,
)  # fmt: skip
