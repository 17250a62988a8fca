"""Patch tracks: division of clusters into painting patches, planned from the statistics of the step "cluster".

A patch track is a cluster over a range of frames that is painted once. A single painting for minutes of changing light,
or for a pan around a whole room, would need unbounded memory and match no frame well. A long cluster is therefore
divided into several tracks of equal length, each with its own master frame; successive tracks are cross-faded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pipeline.frames import Flow, Labels, Plane
from pipeline.methods.base import PlanContext, TaskResult
from pipeline.methods.patches.params import PatchesParams, TableArea
from pipeline.methods.patches.patch_styles import BACKGROUND
from pipeline.methods.patches.scan import WorkingGrid, shots

LEAST_BACKGROUND = 0.05
"""Mean area of a further patch of the background over the frames of its shot, as a fraction of the frame."""
FADE_FRAMES = 6
"""Length of the cross-fade between successive tracks of a cluster, frames."""
LARGE_AREA = 20_000
"""Area of a track, working px, from which brushes do not depend on it (table 1 of zhang2011patches ends at 512 px of a
frame 344 px high, which are fewer on every grid)."""


@dataclass(frozen=True)
class PatchTrack:
    """A painting patch: one cluster over a range of frames.

    Attributes:
        key: prefix of its task and artefact names.
        label: label of its cluster in the shot of frames [begin, end).
        start, stop: frames [start, stop) that show the patch, including cross-fades.
        master: frame whose coordinates the panorama uses.
        fade_in, fade_out: whether the first or last `FADE_FRAMES` frames are shared with another track of the cluster.
        area: sum of the cluster's areas over all frames, working px.
        background: whether it is a patch of the background.
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
    background: bool

    def fade_weight(self, index: int) -> float:
        """Cross-fade weight of this track at a frame, 0..1; the tracks of a cluster sum to 1."""
        weight = 1.0
        if self.fade_in:
            weight = min(weight, (index - self.start + 1) / (FADE_FRAMES + 1))
        if self.fade_out:
            weight = min(weight, (self.stop - index) / (FADE_FRAMES + 1))
        return max(weight, 0.0)

    def table_area(self, kind: TableArea) -> float:
        """Area that determines the size of the strokes, working px: summed over all frames, or the mean of a frame."""
        return self.area if kind == "all-frames" else self.area / (self.stop - self.start)

    def args(self, kind: TableArea) -> TaskResult:
        """The attributes as JSON values for the arguments of a task. An area that is too large to decide anything is
        not told exactly: a correction of other frames of its last run then leaves the track's tasks as they are."""
        frames = 1 if kind == "all-frames" else self.stop - self.start
        return self.__dict__ | {"area": min(self.area, LARGE_AREA * frames)}


LabelRow = list[float]
"""Statistics of a label in a run: first and last frame, total area, frame of the largest area, that area, and travelled
distance. Areas and distance in working px."""


def add_label_statistics(
    rows: dict[str, LabelRow], labels: Labels, forward: tuple[Flow, Plane] | None, index: int
) -> None:
    """Update the statistics of a run by frame `index`, in place.

    Args:
        rows: statistics of each label of the run so far, by the label's decimal digits.
        labels: int32 (h, w), labels of the frame; 0 is not counted.
        forward: flow to the next frame, which determines how far a label travels, |u| + |v|, working px, and its
            reliability; None at the end of the shot.
    """
    speed = np.zeros(labels.shape) if forward is None else np.abs(forward[0][..., 0]) + np.abs(forward[0][..., 1])
    areas, travel = np.bincount(labels.ravel()), np.bincount(labels.ravel(), weights=speed.ravel())
    for label in np.flatnonzero(areas[1:]) + 1:
        area, distance = int(areas[label]), round(float(travel[label] / areas[label]), 3)
        row = rows.setdefault(str(label), [index, index, 0, index, 0, 0.0])
        row[1], row[2], row[5] = index, row[2] + area, round(row[5] + distance, 3)
        if area > row[4]:
            row[3], row[4] = index, area


@dataclass
class _RunStatistics:
    """Statistics of a label in one run: frames, areas in working px, and travelled distance in working px."""

    first: int
    last: int
    area: int
    largest_frame: int
    largest_area: int
    travel: float


def patch_tracks(context: PlanContext[PatchesParams]) -> list[PatchTrack]:
    """All painting patches of a video, in the order of their shots and labels."""
    results = {**context.results["cluster"], **context.results.get("correct", {})}
    found = []
    for begin, end in shots(context):
        table = _shot_statistics(results, begin, end)
        background = background_labels(table, end - begin, context)
        for label, rows in sorted(table.items()):
            found += [
                replace(track, background=label in background) for track in _divide(label, rows, begin, end, context)
            ]
    return found


def background_labels(
    table: Mapping[int, list[_RunStatistics]], frames: int, context: PlanContext[PatchesParams]
) -> set[int]:
    """Labels of a shot's background: `BACKGROUND`, and the largest of those that cover enough of its frames.

    Args:
        table: statistics of each label; frames: number of frames of the shot.
    """
    width, height = WorkingGrid.of((context.video.width, context.video.height)).size
    areas = {label: sum(row.area for row in rows) / frames for label, rows in table.items() if label != BACKGROUND}
    large = [label for label, area in areas.items() if area >= LEAST_BACKGROUND * width * height]
    chosen = sorted(large, key=lambda label: (-areas[label], label))[: context.params.background_patches - 1]
    return {BACKGROUND, *chosen}


def _shot_statistics(results: Mapping[str, TaskResult], begin: int, end: int) -> dict[int, list[_RunStatistics]]:
    """Statistics of each label of a shot, one entry per run."""
    table: dict[int, list[_RunStatistics]] = {}
    for key in sorted(results):
        for label, values in results[key].get("labels", {}).items():
            first, last, area, largest_frame, largest_area, travel = values
            if begin <= first < end:
                row = _RunStatistics(
                    int(first), int(last), int(area), int(largest_frame), int(largest_area), float(travel)
                )
                table.setdefault(int(label), []).append(row)
    return table


def _divide(
    label: int, rows: list[_RunStatistics], begin: int, end: int, context: PlanContext[PatchesParams]
) -> Iterator[PatchTrack]:
    """Divide a cluster into tracks of equal length, within the limits on duration and travelled distance."""
    first, last = rows[0].first, rows[-1].last + 1
    if last - first < 2:
        return
    side = max(WorkingGrid.of((context.video.width, context.video.height)).size)
    by_travel = math.ceil(sum(row.travel for row in rows) / (context.params.longest_travel * side))
    by_duration = math.ceil((last - first) / context.params.longest_patch)
    count = max(1, by_duration, min(by_travel, (last - first) // (2 * FADE_FRAMES)))
    bounds = [first + (last - first) * part // count for part in range(count + 1)]
    for start, stop in pairwise(bounds):
        faded_start = start - (FADE_FRAMES // 2 if start > first else 0)
        faded_stop = stop + (FADE_FRAMES - FADE_FRAMES // 2 if stop < last else 0)
        if (chosen := _master(rows, faded_start, faded_stop)) is None:
            continue
        master, area = chosen
        key = f"s{begin:07d}-l{label:05d}-f{start:07d}"
        fades = start > first, stop < last
        yield PatchTrack(key, label, begin, end, faded_start, faded_stop, master, *fades, area, label == BACKGROUND)


def _master(rows: list[_RunStatistics], start: int, stop: int) -> tuple[int, int] | None:
    """Choose the master frame in [start, stop); return it with the summed area of the runs, working px.

    Candidates have at least 0.9 of the largest known area. The one nearest to the middle is chosen, since errors of
    concatenated warps grow with the distance from the master. None if no frame is known to contain the cluster.
    """
    near = [row for row in rows if row.last >= start and row.first < stop]
    known = {frame: 0 for row in near for frame in (row.first, row.last)}
    known |= {row.largest_frame: row.largest_area for row in near}
    inside = {frame: area for frame, area in known.items() if start <= frame < stop}
    if not inside:
        return None
    large = [frame for frame, area in inside.items() if area >= 0.9 * max(inside.values())]
    middle = (start + stop) / 2
    return min(large, key=lambda frame: (abs(frame - middle), frame)), sum(row.area for row in near)
