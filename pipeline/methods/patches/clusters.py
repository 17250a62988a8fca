"""Step "cluster": label maps of all frames, run after run of a shot, so that a label means the same in all of them.

    flow-<run>   how everything in the windows of a run moves
    run-<run>    its label maps; it goes on from those of the run before, so that identity needs no matching afterwards

Label maps are a chain; flow is parallel, and costs twice as much. Both are one step, so that while one worker follows
the chain the others are not idle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import label_map, mask_map
from pipeline.methods.patches.links import Links
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import RUN, flow_key, run_flow, run_key, run_of, runs
from pipeline.methods.patches.tracking import Tracker, track


def plan_cluster(brief: Brief) -> list[Task]:
    if brief.params.temporal == "off":
        return []
    tasks, chain = list[Task](), list[Task]()
    for start, stop, begin, end in runs(brief):
        args = {"start": start, "stop": stop, "begin": begin, "end": end}
        tasks.append(Task(flow_key(start), args, weight=0.3 * (stop - start)))
        tasks += chain
        chain = [_labelling(args)] if brief.params.temporal == "on" else []
    return tasks + chain


def _labelling(args: dict[str, int]) -> Task:
    start, before = args["start"], args["start"] - RUN
    after = [flow_key(start)] + ([flow_key(before), run_key(before)] if start > args["begin"] else [])
    return Task(run_key(start), args, tuple(after), weight=0.15 * (args["stop"] - start))


def run_cluster(task: Task, bench: Bench) -> Note:
    """Flow, or label maps: artefacts are those of `run_flow` and of `run_labels`."""
    return run_flow(task, bench) if task.key.startswith("flow") else run_labels(task, bench)


def run_labels(task: Task, bench: Bench) -> Note:
    """Label maps "labels-<frame>", uint16 (h, w), of frames [start, stop); the note tells where each label is."""
    params: PatchesParams = bench.params
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    links, grid = Links(bench, begin, RUN), Grid.of(bench.size)
    tracker = _resume(bench, task, params)
    corrected = bench.images("labels") if bench.has("labels") else {}
    masks = bench.images("masks") if bench.has("masks") else {}
    kept: dict[str, NDArray[Any]] = {}
    census: dict[str, list[float]] = {}
    for index in range(start, stop):
        with bench.clock("cluster"):
            if index in corrected:
                labels = tracker.correct(index, label_map(corrected[index], grid, index))
            else:
                said = mask_map(masks[index], grid, index) if index in masks else None
                labels = track(tracker, links, index, params, said)
        kept[f"labels-{index}"] = small_labels(labels)
        if index in tracker.grounds:
            kept[f"ground-{index}"] = tracker.grounds[index].astype(np.uint8)
        count(census, labels, links, index)
        bench.progress((index + 1 - start) / (stop - start))
    kept["next"] = np.array([tracker.next_label, tracker.begin])
    bench.save(task.key, kept)
    return {"labels": census}


def _resume(bench: Bench, task: Task, params: PatchesParams) -> Tracker:
    if task.args["start"] == task.args["begin"]:
        return Tracker(begin=task.args["begin"])
    kept = bench.load("cluster", run_key(task.args["start"] - RUN))
    maps, grounds = (
        {int(key.removeprefix(kind)): value.astype(np.int32) for key, value in kept.items() if key.startswith(kind)}
        for kind in ("labels-", "ground-")
    )
    fresh, begin = (int(value) for value in kept["next"])
    tracker = Tracker({key: value for key, value in maps.items() if key >= begin}, grounds, fresh, begin)
    tracker.trim(task.args["start"] - 1, params.window)
    return tracker


def count(census: dict[str, list[float]], labels: Labels, links: Links, index: int) -> None:
    """Per label: first and last frame, total area, frame of the largest area, that area, and how far it has moved."""
    pair = links.ahead(index)
    speed = np.zeros(labels.shape) if pair is None else np.abs(pair[0][..., 0]) + np.abs(pair[0][..., 1])
    areas, travel = np.bincount(labels.ravel()), np.bincount(labels.ravel(), weights=speed.ravel())
    for label in np.flatnonzero(areas[1:]) + 1:
        area, way = int(areas[label]), round(float(travel[label] / areas[label]), 3)
        row = census.setdefault(str(label), [index, index, 0, index, 0, 0.0])
        row[1], row[2], row[5] = index, row[2] + area, round(row[5] + way, 3)
        if area > row[4]:
            row[3], row[4] = index, area


def small_labels(labels: Labels) -> NDArray[Any]:
    """Labels to be kept, uint8 while there are few: every later task reads them."""
    return labels.astype(np.uint8 if labels.max(initial=0) < 256 else np.uint16)


class LabelMaps:
    """Reads the final label maps, of the cluster step or as corrected since, holding a few runs in memory."""

    def __init__(self, bench: Bench, begin: int, most: int = 3) -> None:
        self._bench, self._begin, self._most = bench, begin, most
        self._held: dict[int, dict[str, NDArray[Any]]] = {}
        self._step = "correct" if bench.has("labels") else "cluster"

    def __call__(self, index: int) -> Labels | None:
        """int32 (h, w) of frame `index`; None before the shot."""
        if index < self._begin:
            return None
        start = run_of(index, self._begin)
        if start not in self._held:
            self._held[start] = self._bench.load(self._step, run_key(start))
            while len(self._held) > self._most:
                del self._held[next(iter(self._held))]
        return self._held[start][f"labels-{index}"].astype(np.int32)

    def sure(self, index: int) -> Labels:
        """int32 (h, w) of a frame that is in the shot."""
        found = self(index)
        assert found is not None
        return found
