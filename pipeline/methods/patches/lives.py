"""Lives: how long each painting patch lasts. Pure planning from the notes of the cluster step.

A patch is a cluster over a run of frames. It may last as long as the cluster does; but a painting that has to hold for
minutes of changing light, or for a pan round a whole room, would need unbounded memory and fit nothing any more. So a
long cluster has several lives of even length, each with a master frame of its own, and one fades over into the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from pipeline.methods.base import Brief
from pipeline.methods.patches.grid import Grid

FADE = 6
"""Frames over which a life fades into the next one."""
FARTHEST = 2.5
"""Sides of the frame that a patch may travel within a life: what bounds a panorama's size."""


@dataclass(frozen=True)
class Life:
    """A painting patch.

    Attributes:
        key: of its task and artefacts.
        label: of its cluster in the shot that begins at frame `begin` and ends before `end`.
        start, stop: its frames, faded ones included.
        master: the frame in whose pixels it is painted.
        fade_in, fade_out: whether it shares its first, or last, FADE frames with another life.
        area: of its cluster in all frames, working px.
    """

    key: str
    label: int
    begin: int
    end: int
    start: int
    stop: int
    master: int
    fade_in: bool
    fade_out: bool
    area: int

    def weight(self, index: int) -> float:
        """Share of this life in its cluster's paint at a frame, 0..1; lives of a cluster sum to 1."""
        share = 1.0
        if self.fade_in:
            share = min(share, (index - self.start + 1) / (FADE + 1))
        if self.fade_out:
            share = min(share, (self.stop - index) / (FADE + 1))
        return max(share, 0.0)

    def args(self) -> dict[str, Any]:
        return dict(self.__dict__)


@dataclass
class _Row:
    """What one run's note says of a label."""

    first: int
    last: int
    area: int
    best: int
    best_area: int
    travel: float


def lives(brief: Brief) -> list[Life]:
    """All painting patches of a video, in the order of their shots and labels."""
    scan = brief.notes["scan"]["video"]
    edges = [0, *scan["cuts"], scan["frames"]]
    census = brief.notes.get("correct") or brief.notes["cluster"]
    found = []
    for begin, end in pairwise(edges):
        for label, rows in sorted(_census(census, begin, end).items()):
            found += list(_split(label, rows, begin, end, brief))
    return found


def _census(notes: Mapping[str, Mapping[str, Any]], begin: int, end: int) -> dict[int, list[_Row]]:
    """Rows of every label of a shot, by run."""
    table: dict[int, list[_Row]] = {}
    for key in sorted(notes):
        for label, values in notes[key].get("labels", {}).items():
            first, last, area, best, best_area, travel = values
            if begin <= first < end:
                row = _Row(int(first), int(last), int(area), int(best), int(best_area), float(travel))
                table.setdefault(int(label), []).append(row)
    return table


def _split(label: int, rows: list[_Row], begin: int, end: int, brief: Brief) -> Iterator[Life]:
    """A life for every part of even length that is short enough, and does not travel too far."""
    first, last = rows[0].first, rows[-1].last + 1
    if last - first < 2:
        return
    side = max(Grid.of((brief.video.width, brief.video.height)).size)
    far = math.ceil(sum(row.travel for row in rows) / (FARTHEST * side))
    count = max(1, math.ceil((last - first) / brief.params.longest_patch), min(far, (last - first) // (2 * FADE)))
    bounds = [first + (last - first) * part // count for part in range(count + 1)]
    for start, stop in pairwise(bounds):
        a, b = start - (FADE // 2 if start > first else 0), stop + (FADE - FADE // 2 if stop < last else 0)
        if (chosen := _master(rows, a, b)) is None:
            continue
        master, area = chosen
        key = f"s{begin:07d}-l{label:05d}-f{start:07d}"
        yield Life(key, label, begin, end, a, b, master, start > first, stop < last, area)


def _master(rows: list[_Row], start: int, stop: int) -> tuple[int, int] | None:
    """Frame of the largest area within [start, stop), as far as runs' notes know, and the area of all frames.

    Among frames nearly as large the one nearest to the middle: warps add up on the way to either end. None if no frame
    is known to have the cluster.
    """
    near = [row for row in rows if row.last >= start and row.first < stop]
    known = {frame: 0 for row in near for frame in (row.first, row.last)} | {row.best: row.best_area for row in near}
    inside = {frame: area for frame, area in known.items() if start <= frame < stop}
    if not inside:
        return None
    large = [frame for frame, area in inside.items() if area >= 0.9 * max(inside.values())]
    middle = (start + stop) / 2
    return min(large, key=lambda frame: (abs(frame - middle), frame)), sum(row.area for row in near)
