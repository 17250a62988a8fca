"""Ranges of frames as people write them: counted from 0, by the numbers of images, or by timecode."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from statistics import median

from pipeline.errors import BadParameter
from pipeline.video.passthrough import open_source, timecode_tag
from pipeline.video.reader import VideoReader
from pipeline.video.sequence_options import USUAL, SequenceOptions
from pipeline.video.timecode import frame_of, is_timecode, usual_rate

_COUNTED = re.compile(r"(\d+):(\d+)")
_NUMBERED = re.compile(r"#(\d+)-#?(\d+)")
_LABELLED = re.compile(r"([\d:;.]+)-([\d:;.]+)")
HELP = (
    "FIRST:END from 0 without END, #1001-#1048 (numbers of images), or 01:00:00:00-01:00:02:00 (timecode, without END)"
)


@dataclass(frozen=True)
class SourceFacts:
    """The clip that a range selects from: length, frame rate, timecode of the first frame ("": none), and numbers of
    images."""

    frames: int
    fps: float
    timecode: str = ""
    numbers: tuple[int, ...] = ()

    @property
    def rate(self) -> Fraction:
        return usual_rate(self.fps) or Fraction(self.fps).limit_denominator(1001)


@dataclass(frozen=True)
class Span:
    """Frames of a source, before the source is known.

    Attributes:
        first, end: [first, end), in the unit of `kind`.
        kind: "count" (from 0), "number" (numbers of images), "seconds" (timecode as seconds of time: what cuts have),
            or "label".
        labels: timecodes of first and end, if they are text.
        starts_s: time of the source's first frame, seconds, on the clock that ranges in seconds use; from the cut.
    """

    first: Fraction = Fraction(0)
    end: Fraction = Fraction(0)
    kind: str = "count"
    labels: tuple[str, str] = ("", "")
    starts_s: Fraction | None = None

    def resolve(self, facts: SourceFacts, field: str) -> tuple[int, int]:
        """[first, end), counted from 0. Raises BadParameter: not in the source."""
        if self.kind == "label":
            found = (self._labelled(facts, self.labels[0], field), self._labelled(facts, self.labels[1], field))
        elif self.kind == "number":
            found = self._numbered(facts, field)
        elif self.kind == "seconds":
            found = self._timed(facts)
        else:
            found = int(self.first), int(self.end)
        if not 0 <= found[0] < found[1] <= facts.frames:
            raise BadParameter(
                f"Frames {found[0]} to {found[1]} are asked for, and the source has 0 to {facts.frames}"
                + (f", the first at {facts.timecode}." if facts.timecode else "."),
                field=field, value=self.labels[0] or None, remedy="Check the range and the source.",
            )  # fmt: skip
        return found

    def _labelled(self, facts: SourceFacts, label: str, field: str) -> int:
        if not facts.timecode:
            raise BadParameter(
                "The source has no timecode.", field=field, value=label, remedy="Give the range as FIRST:END, from 0."
            )
        return frame_of(label, facts.rate, field) - frame_of(facts.timecode, facts.rate, field)

    def _numbered(self, facts: SourceFacts, field: str) -> tuple[int, int]:
        first, last = int(self.first), int(self.end) - 1
        for number in (first, last):
            if number not in facts.numbers:
                has = f"{facts.numbers[0]} to {facts.numbers[-1]}" if facts.numbers else "none: its frames count from 0"
                raise BadParameter(
                    f"The source has no image of that number; it has {has}.", field=field, value=number,
                    remedy="Give numbers of its images.",
                )  # fmt: skip
        return facts.numbers.index(first), facts.numbers.index(last) + 1

    def _timed(self, facts: SourceFacts) -> tuple[int, int]:
        """Frames from times. A source's own scale begins at its timecode, or at its first image's number; times before
        that count from 0."""
        first, end = round(self.first * facts.rate), round(self.end * facts.rate)
        if self.starts_s is not None:
            begin = round(self.starts_s * facts.rate)
        elif facts.timecode:
            begin = frame_of(facts.timecode, facts.rate)
        else:
            begin = facts.numbers[0] if facts.numbers else 0
        return (first - begin, end - begin) if first >= begin else (first, end)


def span_of(text: str, field: str = "--frames") -> Span | None:
    """Parse a range; empty: None. Raises BadParameter."""
    if not text:
        return None
    if found := _COUNTED.fullmatch(text):
        return Span(Fraction(found[1]), Fraction(found[2]))
    if found := _NUMBERED.fullmatch(text):
        return Span(Fraction(found[1]), Fraction(int(found[2]) + 1), "number")
    if (found := _LABELLED.fullmatch(text)) and is_timecode(found[1]) and is_timecode(found[2]):
        return Span(kind="label", labels=(found[1], found[2]))
    raise BadParameter("FIRST:END is expected.", field=field, value=text, remedy=f"Write {HELP}.")


def facts_of(path: Path, sequence: SequenceOptions = USUAL) -> SourceFacts:
    """Facts of a film, or of numbered images that are read with these options. Raises BadMedia."""
    with VideoReader(path, sequence=sequence) as reader:
        frames, fps, numbers = reader.frames, _pace(reader), reader.index.numbers
    source = open_source(path) if path.is_file() else None
    if source is None:
        return SourceFacts(frames, fps, "", numbers)
    with source:
        label = timecode_tag(source)
    return SourceFacts(frames, fps, label if is_timecode(label) and usual_rate(fps) else "", numbers)


def _pace(reader: VideoReader) -> float:
    """The frame rate. If the mean is no usual one (a frame is missing, or the last one stays), that of most seconds."""
    pts = [int(time) for time in reader.index.pts]
    span = min(24, len(pts) - 1)
    if span < 1 or usual_rate(reader.fps) is not None:
        return float(reader.fps)
    step = median(later - earlier for earlier, later in zip(pts, pts[span:], strict=False))
    return span / (step * float(reader.index.time_base)) if step > 0 else float(reader.fps)
