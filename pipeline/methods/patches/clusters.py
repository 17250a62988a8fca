"""Step "cluster": label maps of all frames, with labels that are consistent over a shot.

    flow-<run>   optical flow between the frames of each window
    run-<run>    label maps; each run continues from the previous one, so labels need no matching afterwards

Flow tasks are parallel and cost about twice as much as the label tasks, which form a chain. Both belong to one step, so
that workers compute flow while one worker follows the chain.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.artefacts import LABELS
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import label_map, mask_map
from pipeline.methods.patches.links import Links
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import RUN, flow_key, run_flow, run_key, run_of, runs
from pipeline.methods.patches.tracking import Tracker, track


def plan_cluster(context: PlanContext[PatchesParams]) -> list[Task]:
    if context.params.temporal == "off":
        return []
    tasks, chain = list[Task](), list[Task]()
    for start, stop, begin, end in runs(context):
        args = {"start": start, "stop": stop, "begin": begin, "end": end}
        tasks.append(Task(flow_key(start), args, weight=0.3 * (stop - start)))
        tasks += chain
        chain = [_labelling(args)] if context.params.temporal == "on" else []
    return tasks + chain


def _labelling(args: dict[str, int]) -> Task:
    start, before = args["start"], args["start"] - RUN
    after = [flow_key(start)] + ([flow_key(before), run_key(before)] if start > args["begin"] else [])
    return Task(run_key(start), args, tuple(after), weight=0.15 * (args["stop"] - start))


def run_cluster(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute flow or label maps, see `run_flow` and `run_labels` for the artefacts."""
    return run_flow(task, context) if task.key.startswith("flow") else run_labels(task, context)


def run_labels(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps "labels-<frame>" of frames [start, stop).

    The result has the statistics of each label, and the uncertainty of each label in each frame, 0..1, which is also
    saved as the file "uncertainty-<run>.json" with the artefact "labels".
    """
    params = context.params
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    links, grid = Links(context, begin, RUN), Grid.of(context.size)
    tracker = _resume(context, task, params)
    corrected = context.images("labels") if context.has("labels") else {}
    masks = context.images("masks") if context.has("masks") else {}
    kept: dict[str, NDArray[Any]] = {}
    census: dict[str, list[float]] = {}
    uncertainty: dict[str, dict[str, float]] = {}
    for index in range(start, stop):
        with context.clock("cluster"):
            if index in corrected:
                labels = tracker.correct(index, label_map(corrected[index], grid, index))
            else:
                said = mask_map(masks[index], grid, index) if index in masks else None
                labels = track(tracker, links, index, params, said)
        kept[f"labels-{index}"] = small_labels(labels)
        if index in tracker.grounds:
            kept[f"ground-{index}"] = tracker.grounds[index].astype(np.uint8)
        uncertainty[str(index)] = {str(label): value for label, value in tracker.uncertainty.items()}
        count(census, labels, links, index)
        context.progress((index + 1 - start) / (stop - start))
    kept["next"] = np.array([tracker.next_label, tracker.begin])
    context.save(task.key, kept)
    if context.wants(LABELS):
        context.save_file(f"uncertainty-{task.key}.json", json.dumps(uncertainty).encode(), "application/json")
    return {"labels": census, "uncertainty": uncertainty}


def _resume(context: TaskContext[PatchesParams], task: Task, params: PatchesParams) -> Tracker:
    if task.args["start"] == task.args["begin"]:
        return Tracker(begin=task.args["begin"])
    kept = context.load("cluster", run_key(task.args["start"] - RUN))
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
    """Convert labels for storage: uint8 if they fit, else uint16. All later tasks read these arrays."""
    return labels.astype(np.uint8 if labels.max(initial=0) < 256 else np.uint16)


class LabelMaps:
    """Reads the final label maps, of the step "correct" if it has run, else "cluster"; caches `most` runs."""

    def __init__(self, context: TaskContext[PatchesParams], begin: int, most: int = 3) -> None:
        self._context, self._begin, self._most = context, begin, most
        self._held: dict[int, dict[str, NDArray[Any]]] = {}
        self._step = "correct" if context.has("labels") else "cluster"

    def __call__(self, index: int) -> Labels | None:
        """int32 (h, w) of frame `index`; None before the shot."""
        if index < self._begin:
            return None
        start = run_of(index, self._begin)
        if start not in self._held:
            self._held[start] = self._context.load(self._step, run_key(start))
            while len(self._held) > self._most:
                del self._held[next(iter(self._held))]
        return self._held[start][f"labels-{index}"].astype(np.int32)

    def sure(self, index: int) -> Labels:
        """int32 (h, w) of a frame that is in the shot."""
        found = self(index)
        assert found is not None
        return found
