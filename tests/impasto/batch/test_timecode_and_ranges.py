"""Timecode, and ranges of frames as people write them."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from impasto.ranges import SourceFacts, Span, facts_of, span_of
from pipeline.errors import BadParameter
from pipeline.video.timecode import frame_of, label_of, shifted

NTSC = Fraction(30000, 1001)


@pytest.mark.parametrize(
    ("label", "rate", "frame"),
    [
        ("01:00:00:00", Fraction(25), 90_000),
        ("00:00:59;29", NTSC, 1799),
        ("00:01:00;02", NTSC, 1800),
        ("00:10:00;00", NTSC, 17_982),
        ("01:00:00;00", NTSC, 107_892),
        ("01:00:00:00", Fraction(24000, 1001), 86_400),
        ("00:01:00;04", Fraction(60000, 1001), 3600),
    ],
)
def test_labels_count_as_in_st_12(label: str, rate: Fraction, frame: int) -> None:
    assert frame_of(label, rate) == frame
    assert label_of(frame, rate, ";" in label) == label


def test_every_label_of_eleven_minutes_comes_back() -> None:
    for frame in range(0, 20_000, 7):
        assert frame_of(label_of(frame, NTSC, drop=True), NTSC) == frame
    assert shifted("23:59:59:24", 1, Fraction(25)) == "00:00:00:00"


@pytest.mark.parametrize(
    ("text", "facts", "frames"),
    [
        ("10:60", SourceFacts(100, 25.0), (10, 60)),
        ("#1001-#1003", SourceFacts(4, 24.0, "", (1000, 1001, 1002, 1003)), (1, 4)),
        ("01:00:01:00-01:00:02:00", SourceFacts(100, 25.0, "01:00:00:00"), (25, 50)),
        ("01:00:59;28-01:01:00;02", SourceFacts(100, 29.97, "01:00:59;28"), (0, 2)),
    ],
)
def test_ranges_are_counts_numbers_or_timecode(text: str, facts: SourceFacts, frames: tuple[int, int]) -> None:
    span = span_of(text)
    assert span and span.resolve(facts, "--frames") == frames


@pytest.mark.parametrize(
    ("text", "facts", "why"),
    [
        ("60:100", SourceFacts(90, 25.0), "0 to 90"),
        ("#999-#1001", SourceFacts(2, 24.0, "", (1000, 1001)), "1000 to 1001"),
        ("01:00:00:00-01:00:02:00", SourceFacts(100, 25.0), "no timecode"),
        ("01:00:00:25-01:00:02:00", SourceFacts(100, 25.0, "01:00:00:00"), "25 frames per second"),
    ],
)
def test_a_range_outside_the_source_is_refused(text: str, facts: SourceFacts, why: str) -> None:
    span = span_of(text)
    with pytest.raises(BadParameter, match=why):
        assert span and span.resolve(facts, "--frames")


def test_a_late_end_does_not_change_the_rate(tmp_path: Path) -> None:
    """The mean rate of such a film is lower, and times would become other frames."""
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        stream = out.add_stream("libx264", rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for index in [*range(40), 44]:
            picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 5 * index, np.uint8), format="rgb24")
            picture.pts = index
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))
    facts = facts_of(tmp_path / "a.mp4")
    assert (facts.rate, facts.frames) == (24, 41)
    assert Span(Fraction(1), Fraction(3, 2), "seconds").resolve(facts, "cut") == (24, 36)


def test_other_texts_are_refused() -> None:
    assert span_of("") is None
    with pytest.raises(BadParameter, match="timecode"):
        span_of("1001-1048")
