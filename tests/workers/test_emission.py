"""Emitted frames are encoded in order, large ones in a separate thread, whose errors reach the method."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import BadParameter
from pipeline.frames import Frame
from pipeline.video.index import Index
from pipeline.video.writer import SegmentSpec, segment_writer
from workers.execution.emission import Emission, EmitError

SMALL, LARGE = (64, 48), (640, 480)
COUNT = 12
TIMES = np.arange(COUNT)
INDEX = Index(TIMES, TIMES[:1], COUNT, Fraction(1, 25), True)


def frames(size: tuple[int, int]) -> list[Frame]:
    return [np.full((size[1], size[0], 3), 20 * n, np.uint8) for n in range(COUNT)]


def spec(size: tuple[int, int], quality: int = 20) -> SegmentSpec:
    return SegmentSpec("mp4", size, INDEX.time_base, INDEX.fps, quality)


@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_a_frame_that_changes_after_it_was_emitted_is_encoded_as_it_was(size: tuple[int, int], tmp_path: Path) -> None:
    with segment_writer(tmp_path / "plain", spec(size)) as writer:
        for n, frame in enumerate(frames(size)):
            writer.write(n, frame, n, n + 1)
    emission = Emission(tmp_path / "emitted", spec(size), INDEX, (0, COUNT))
    canvas = np.empty((size[1], size[0], 3), np.uint8)
    for n, frame in enumerate(frames(size)):
        canvas[...] = frame
        emission.take(n, canvas)
    canvas[...] = 0
    assert emission.finish(None) == tmp_path / "emitted"
    emission.close()
    assert (tmp_path / "emitted").read_bytes() == (tmp_path / "plain").read_bytes()


def test_an_error_of_the_encoder_is_raised(tmp_path: Path) -> None:
    emission = Emission(tmp_path / "emitted", spec(LARGE, quality=99), INDEX, (0, 1))
    emission.take(0, frames(LARGE)[0])
    with pytest.raises(BadParameter):
        emission.finish(None)
    emission.close()


def test_frames_come_in_order(tmp_path: Path) -> None:
    emission = Emission(tmp_path / "emitted", spec(SMALL), INDEX, (0, COUNT))
    with pytest.raises(EmitError):
        emission.take(1, frames(SMALL)[1])
    emission.close()
