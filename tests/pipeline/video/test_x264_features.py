"""The CPU features that x264 may use: bytes must not depend on the processor (see `_X264_REPEATABLE_ASM`)."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.formats import codecs
from pipeline.video.writer import SegmentSpec, segment_writer

AVX_512F, AVX2 = 13, 11


def _encoded(path: Path) -> bytes:
    noise = np.random.default_rng(3).integers(0, 255, (64, 96, 3), np.uint8)
    with segment_writer(path, SegmentSpec("mp4", (96, 64), Fraction(1, 25), 25.0)) as segment:
        for index in range(24):
            segment.write(index, np.roll(noise, index, axis=1), index, index + 1)
    return path.read_bytes()


@pytest.mark.skipif(not cv2.checkHardwareSupport(AVX2), reason="the limited list of features needs AVX2")
def test_a_processor_with_avx_512_gives_the_bytes_of_one_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cv2, "checkHardwareSupport", lambda feature: feature != AVX_512F)
    without = _encoded(tmp_path / "without")
    assert "asm" not in codecs._x264_params()
    monkeypatch.setattr(cv2, "checkHardwareSupport", lambda feature: True)
    assert "asm=" in codecs._x264_params()
    if not _has_avx_512():
        assert _encoded(tmp_path / "with") == without


def _has_avx_512() -> bool:
    return "avx512f" in Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else False
