"""Damage of a video file: frames that cannot be read, and frames that its header announces and that are missing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

from pipeline.video.index import Index

Run = tuple[int, int]
"""Frames [start, stop)."""
_RUNS_NAMED = 3
_RUNS_KEPT = 1000
"""More runs than these are merged into their neighbours, so that a report stays small."""


@dataclass(frozen=True)
class Damage:
    """Missing and unreadable frames of a video.

    Attributes:
        frames: number of frames that the file should have.
        unreadable: runs of frames that are incomplete or cannot be decoded, ascending. Such a frame is shown
            incomplete, or replaced by the previous frame.
        missing: runs of frames that are not in the file, ascending.
    """

    frames: int
    unreadable: tuple[Run, ...] = ()
    missing: tuple[Run, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.unreadable or self.missing)

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        """The inverse of `as_json`."""
        unreadable, missing = (merged(map(tuple, value[name])) for name in ("unreadable", "missing"))
        return cls(int(value["frames"]), unreadable, missing)

    def as_json(self) -> dict[str, Any]:
        return {
            "frames": self.frames,
            "unreadable": [list(run) for run in self.unreadable],
            "missing": [list(run) for run in self.missing],
        }

    def union(self, other: Damage) -> Damage:
        """The damage of both reports, which are about the same file."""
        unreadable, missing = merged((*self.unreadable, *other.unreadable)), merged((*self.missing, *other.missing))
        return Damage(max(self.frames, other.frames), unreadable, missing)

    def describe(self, what: str = "The source") -> str:
        """One sentence, for example "The source is damaged: frames 22-95 of 96 are missing."; empty if whole."""
        parts = [(self.missing, "missing"), (self.unreadable, "unreadable")]
        clauses = [f"{_named(runs, self.frames)} {_be(runs)} {word}" for runs, word in parts if runs]
        return f"{what} is damaged: {' and '.join(clauses)}." if clauses else ""


def damage_of(index: Index, unreadable: Iterable[int]) -> Damage:
    """The damage of a video.

    Args:
        unreadable: indices of the frames that were incomplete or could not be decoded.

    Returns:
        Runs in the numbering of the undamaged video, in which missing frames count.
    """
    missing: list[Run] = []
    for frame, count in index.missing:
        start = frame + sum(stop - begin for begin, stop in missing)
        missing.append((start, start + count))
    numbers = (at + sum(count for frame, count in index.missing if frame <= at) for at in unreadable)
    total = len(index.pts) + sum(count for _, count in index.missing)
    return Damage(total, runs_of(numbers), tuple(missing))


def runs_of(frames: Iterable[int]) -> tuple[Run, ...]:
    """The runs of some frame numbers, in any order."""
    return merged((frame, frame + 1) for frame in frames)


def merged(runs: Iterable[Run]) -> tuple[Run, ...]:
    """Runs in order, those that touch or overlap joined; at most 1000, by closing the smallest gaps."""
    found: list[Run] = []
    for start, stop in sorted(runs):
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(stop, found[-1][1]))
        else:
            found.append((start, stop))
    if len(found) > _RUNS_KEPT:
        gaps = sorted(later[0] - run[1] for run, later in pairwise(found))
        return _closed(found, gaps[len(found) - _RUNS_KEPT - 1])
    return tuple(found)


def _closed(runs: Sequence[Run], gap: int) -> tuple[Run, ...]:
    """The runs, joined where at most `gap` frames lie between two of them."""
    found = [runs[0]]
    for start, stop in runs[1:]:
        if start - found[-1][1] <= gap:
            found[-1] = (found[-1][0], stop)
        else:
            found.append((start, stop))
    return tuple(found)


def _named(runs: Sequence[Run], frames: int) -> str:
    names = [f"{start}" if stop == start + 1 else f"{start}-{stop - 1}" for start, stop in runs[:_RUNS_NAMED]]
    rest = len(runs) - len(names)
    noun = "frame" if _single(runs) else "frames"
    more = f" and {rest} more {'run' if rest == 1 else 'runs'}" if rest else ""
    return f"{noun} {', '.join(names)}{more} of {frames}"


def _be(runs: Sequence[Run]) -> str:
    return "is" if _single(runs) else "are"


def _single(runs: Sequence[Run]) -> bool:
    return len(runs) == 1 and runs[0][1] == runs[0][0] + 1
