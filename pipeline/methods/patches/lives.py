"""Lifetimes of painting patches, planned from the results of the cluster step.

A patch is a cluster over a range of frames. A single painting for minutes of changing light, or for a pan around a
whole room, would need unbounded memory and match no frame well. A long cluster is therefore divided into several
patches ("lives") of equal length, each with its own master frame; successive patches are cross-faded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from pipeline.methods.base import PlanContext
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.params import PatchesParams

FADE = 6
"""Length of the cross-fade between successive patches, frames."""
FARTHEST = 2.5
"""Largest distance a patch may travel in its life, in lengths of the frame's longer side. It bounds the panorama."""


@dataclass(frozen=True)
class Life:
    """A painting patch.

    Attributes:
        key: prefix of its task and artefact names.
        label: label of its cluster in the shot of frames [begin, end).
        start, stop: frames [start, stop) that show the patch, including cross-fades.
        master: frame whose coordinates the panorama uses.
        fade_in, fade_out: whether the first or last `FADE` frames are shared with another patch of the cluster.
        area: sum of the cluster's areas over all frames, working px.
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
        """Cross-fade weight of this patch at a frame, 0..1; the patches of a cluster sum to 1."""
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
    """Statistics of a label in one run: frames, areas in working px, and travelled distance in working px."""

    first: int
    last: int
    area: int
    best: int
    best_area: int
    travel: float


def lives(context: PlanContext[PatchesParams]) -> list[Life]:
    """All painting patches of a video, in the order of their shots and labels."""
    scan = context.results["scan"]["video"]
    edges = [0, *scan["cuts"], scan["frames"]]
    census = context.results.get("correct") or context.results["cluster"]
    found = []
    for begin, end in pairwise(edges):
        for label, rows in sorted(_census(census, begin, end).items()):
            found += list(_split(label, rows, begin, end, context))
    return found


def _census(results: Mapping[str, Mapping[str, Any]], begin: int, end: int) -> dict[int, list[_Row]]:
    """Statistics of each label of a shot, one row per run."""
    table: dict[int, list[_Row]] = {}
    for key in sorted(results):
        for label, values in results[key].get("labels", {}).items():
            first, last, area, best, best_area, travel = values
            if begin <= first < end:
                row = _Row(int(first), int(last), int(area), int(best), int(best_area), float(travel))
                table.setdefault(int(label), []).append(row)
    return table


def _split(label: int, rows: list[_Row], begin: int, end: int, context: PlanContext[PatchesParams]) -> Iterator[Life]:
    """Divide a cluster into patches of equal length, within the limits on duration and travelled distance."""
    first, last = rows[0].first, rows[-1].last + 1
    if last - first < 2:
        return
    side = max(Grid.of((context.video.width, context.video.height)).size)
    far = math.ceil(sum(row.travel for row in rows) / (FARTHEST * side))
    count = max(1, math.ceil((last - first) / context.params.longest_patch), min(far, (last - first) // (2 * FADE)))
    bounds = [first + (last - first) * part // count for part in range(count + 1)]
    for start, stop in pairwise(bounds):
        a, b = start - (FADE // 2 if start > first else 0), stop + (FADE - FADE // 2 if stop < last else 0)
        if (chosen := _master(rows, a, b)) is None:
            continue
        master, area = chosen
        key = f"s{begin:07d}-l{label:05d}-f{start:07d}"
        yield Life(key, label, begin, end, a, b, master, start > first, stop < last, area)


def _master(rows: list[_Row], start: int, stop: int) -> tuple[int, int] | None:
    """Choose the master frame in [start, stop); return it with the summed area of the runs, working px.

    Candidates have at least 0.9 of the largest known area. The one nearest to the middle is chosen, since errors of
    concatenated warps grow with the distance from the master. None if no frame is known to contain the cluster.
    """
    near = [row for row in rows if row.last >= start and row.first < stop]
    known = {frame: 0 for row in near for frame in (row.first, row.last)} | {row.best: row.best_area for row in near}
    inside = {frame: area for frame, area in known.items() if start <= frame < stop}
    if not inside:
        return None
    large = [frame for frame, area in inside.items() if area >= 0.9 * max(inside.values())]
    middle = (start + stop) / 2
    return min(large, key=lambda frame: (abs(frame - middle), frame)), sum(row.area for row in near)
