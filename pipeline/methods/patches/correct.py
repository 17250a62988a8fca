"""Step "correct": recluster the frames between keyframes with corrected label maps (section 4, second pass).

    back-<run>   labels propagated backward from the next keyframe
    run-<run>    blend of both passes: pixels where they agree are seeds; elsewhere links to the previous frame have
                 weight 1 - alpha and links to the next frame alpha, which grows from 0 to 1 between the keyframes

Without corrected label maps the step has no tasks.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Labels
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.clusters import count, small_labels
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import label_map
from pipeline.methods.patches.links import Links
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.scan import RUN, run_key, run_of, runs
from pipeline.methods.patches.tracking import carry_labels, edges_of, frame_evidence
from pipeline.segmentation.components import absorb_specks
from pipeline.segmentation.random_walk import vote

SEED_WEIGHT = 5.0
"""Weight of the seeds, where forward and backward labels agree."""


def plan_correct(context: PlanContext[PatchesParams]) -> list[Task]:
    if context.params.temporal != "on" or "labels" not in context.inputs:
        return []
    keys = context.results["scan"]["video"]["keys"]
    tasks, back = list[Task](), set[int]()
    for start, stop, begin, end in reversed(list(runs(context))):
        here = [key for key in keys if begin <= key < end]
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "keys": here}
        if any(key >= start for key in here):
            after = (_back_key(start + RUN),) if start + RUN in back and start + RUN < end else ()
            tasks.append(Task(_back_key(start), args, after, weight=0.05 * (stop - start)))
            back.add(start)
        needs = tuple(_back_key(at) for at in (start, start + RUN) if at in back and at < end)
        tasks.append(Task(run_key(start), args, needs, weight=0.05 * (stop - start)))
    return tasks


def _back_key(start: int) -> str:
    return f"back-{start:07d}"


def run_correct(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Propagate labels backward, or blend both passes; artefacts have the form of the step "cluster"."""
    return _carry_back(task, context) if task.key.startswith("back") else _join(task, context)


def _carry_back(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps "labels-<frame>" of the frames that have a keyframe at or after them, from the last to the first."""
    start, stop, keys = task.args["start"], task.args["stop"], task.args["keys"]
    links, corrected, grid = Links(context, task.args["begin"], RUN), context.images("labels"), Grid.of(context.size)
    after = context.load("correct", task.after[0]).get(f"labels-{stop}") if task.after else None
    kept: dict[str, NDArray[Any]] = {}
    for index in range(stop - 1, start - 1, -1):
        if index in keys:
            after = label_map(corrected[index], grid, index)
        elif after is not None:
            with context.clock("correct"):
                after = carried_back(after.astype(np.int32), links, index, context.params)
        if after is not None:
            kept[f"labels-{index}"] = small_labels(after)
    context.save(task.key, kept)
    return {}


def carried_back(after: Labels, links: Links, index: int, params: PatchesParams) -> Labels:
    """Labels of frame `index` from those of the next one."""
    evidence = frame_evidence(links, index, index)
    if evidence.ahead is None:
        return after
    flow, reliable = evidence.ahead
    weights = np.where(reliable >= params.reliable, reliable, 0).astype(np.float32)
    return vote(carry_labels(after, flow)[None], weights[None], edges_of(evidence, params))[0]


def _join(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    start, stop, begin, keys = (task.args[name] for name in ("start", "stop", "begin", "keys"))
    links, passes = Links(context, begin, RUN), _Passes(context, task)
    kept: dict[str, NDArray[Any]] = {}
    census: dict[str, list[float]] = {}
    for index in range(start, stop):
        place = bisect_right(keys, index)
        if index in keys or place == len(keys):
            labels = passes.forward(index)
        else:
            first = keys[place - 1] if place else begin
            with context.clock("correct"):
                labels = blended(passes, links, index, (index - first) / (keys[place] - first), context.params)
        kept[f"labels-{index}"] = small_labels(labels)
        count(census, labels, links, index)
    context.save(task.key, kept)
    return {"labels": census}


class _Passes:
    """Label maps of the forward and the backward pass, by frame."""

    def __init__(self, context: TaskContext[PatchesParams], task: Task) -> None:
        self._context, self._begin, self._after = context, task.args["begin"], set(task.after)
        self._held: dict[str, dict[str, NDArray[Any]]] = {}

    def forward(self, index: int) -> Labels:
        return self._get("cluster", run_key(run_of(index, self._begin)), index)

    def back(self, index: int) -> Labels:
        return self._get("correct", _back_key(run_of(index, self._begin)), index)

    def _get(self, step: str, key: str, index: int) -> Labels:
        if key not in self._held:
            self._held[key] = self._context.load(step, key)
        return self._held[key][f"labels-{index}"].astype(np.int32)


def blended(passes: _Passes, links: Links, index: int, alpha: float, params: PatchesParams) -> Labels:
    """Labels of a frame between two keyframes: int32 (h, w). `alpha`, 0..1, is its relative position between them.

    Source: zhang2011patches, section 4.
    """
    evidence = frame_evidence(links, index, index - 1)
    ahead, behind = passes.back(index), passes.forward(index)
    options = [np.where(ahead == behind, ahead, 0)]
    shares = [np.where((ahead == behind) & (ahead > 0), np.float32(SEED_WEIGHT), np.float32(0))]
    for pair, other, part in ((evidence.back, index - 1, 1 - alpha), (evidence.ahead, index + 1, alpha)):
        if pair is None:
            continue
        flow, reliable = pair
        labels = passes.forward(other) if other < index else passes.back(other)
        options.append(carry_labels(labels, flow))
        shares.append(np.where(reliable >= params.reliable, part * params.interframe * reliable, 0))
    labels, _ = vote(np.stack(options), np.stack(shares).astype(np.float32), edges_of(evidence, params))
    area = int(labels.size * params.smallest_cluster / 1000)
    return absorb_specks(labels, max(area // 12, 4), max(area // 3, 8))
