"""Every encoder, again and again, gives the same bytes for the same frames.

H.264 is encoded 100 times: a fault that shows in 3 % of the runs, as that of x264's AVX-512 code did on small frames,
is missed with a probability of 5 %. `IMPASTO_ENCODER_RUNS=2000` repeats every encoder so often, which takes six
minutes of CPU time.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from functools import cache
from pathlib import Path

import pytest

from pipeline.frames import Frame
from pipeline.scenes import scene
from pipeline.video.writer import SegmentSpec, segment_writer
from tests.conftest import TestSettings

SIZE = (96, 64)
FRAMES = 96
RUNS = {("mp4", "h264"): 100}
CODECS = [
    ("mp4", "h264"), ("mp4", "h264-444"), ("mp4", "hevc"), ("mp4", "av1"), ("webm", "vp9"), ("mov", "4444"),
    ("mkv", "ffv1"), ("mkv", "ffv1-16"), ("png", "8"), ("png", "16"), ("tiff", "16"), ("exr", "half"), ("gif", "256"),
]  # fmt: skip


@cache
def frames() -> tuple[Frame, ...]:
    """Moving shapes and, in the middle, a hard cut: 96 frames of 96x64."""
    made = [scene(name, SIZE, frames=FRAMES // 2, fps=12) for name in ("shapes", "portrait")]
    return tuple(shot.image(index) for shot in made for index in range(FRAMES // 2))


def encoded(path: Path, codec: tuple[str, str], quality: int) -> str:
    """SHA-256 of the frames as one segment."""
    spec = SegmentSpec(codec[0], SIZE, Fraction(1, 24), 24.0, quality, codec[1])
    with segment_writer(path, spec) as writer:
        for index, frame in enumerate(frames()):
            writer.write(index, frame, index, index + 1)
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("codec", CODECS, ids="-".join)
def test_the_same_frames_give_the_same_bytes_in_each_run(codec: tuple[str, str], tmp_path: Path) -> None:
    runs = TestSettings().encoder_runs or RUNS.get(codec, 10)
    found = Counter(encoded(tmp_path / "segment", codec, quality=20) for _ in range(runs))
    assert len(found) == 1, f"{len(found)} different files in {found.total()} runs: {sorted(found.values())}"


@pytest.mark.parametrize("codec", CODECS, ids="-".join)
def test_concurrent_encoders_do_not_change_the_bytes(codec: tuple[str, str], tmp_path: Path) -> None:
    """Four encoders run at once, so that threads are interrupted anywhere, on a machine of any size."""
    with ThreadPoolExecutor(4) as pool:
        found = set(pool.map(lambda number: encoded(tmp_path / f"{number}", codec, quality=20), range(24)))
    assert found == {encoded(tmp_path / "alone", codec, quality=20)}
