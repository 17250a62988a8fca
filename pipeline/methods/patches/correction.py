"""Step "correct": clusters frames again from label maps that the user has corrected (zhang2011patches, section 4, the
second pass). Without corrected label maps it has no tasks.

A *span* is a run of frames that is solved again: the frames that the input `label_intervals` names for a corrected map,
else the whole shot. Frames outside all spans keep the labels of the step "cluster" exactly, so that a correction of one
span leaves the tasks of all other frames as they are.

    front-<span>-<run>   labels of the span, clustered forward from each of its corrected maps
    back-<span>-<run>    labels of the span, propagated backward from its corrected maps and from the frame behind it
    run-<run>            blend of both passes for the runs that a span touches: pixels where they agree are seeds;
                         elsewhere links to the previous frame have weight 1 - alpha and links to the next frame alpha,
                         which grows from 0 to 1 between fixed frames: corrected maps, and those around the span

Departure: the paper solves from one corrected frame to the next; the frames around a span count as such here.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.arrays import State
from pipeline.frames import Labels
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.clustering import (
    LabelMaps,
    label_arrays,
    next_frame_labels,
    previous_state,
    stored_uncertainty,
)
from pipeline.methods.patches.motion_clustering import (
    FrameFeatures,
    edge_weights,
    frame_motion,
    uncertainty_of,
    warp_labels,
)
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import LabelRow, add_label_statistics
from pipeline.methods.patches.scan import RUN, WorkingGrid, label_map, run_key, run_start, runs, shots
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.regions.components import absorb_specks
from pipeline.regions.random_walk import vote

SEED_WEIGHT = 5.0
"""Weight of the seeds, where forward and backward labels agree."""


@dataclass(frozen=True)
class FrameSpan:
    """Frames [start, stop) of a shot that are clustered again.

    Attributes:
        keys: frames with corrected label maps, ascending; at least one, all within the span.
    """

    start: int
    stop: int
    keys: tuple[int, ...]


def spans(keys: Mapping[int, tuple[int, int] | None], begin: int, end: int) -> list[FrameSpan]:
    """The spans of the shot [begin, end), ascending. Intervals that overlap are one span.

    Args:
        keys: frame with a corrected label map -> how many frames before and after it are clustered again; None: all
            frames of the shot.
    """
    found: list[FrameSpan] = []
    for key, reach in sorted(keys.items()):
        if not begin <= key < end:
            continue
        start, stop = (begin, end) if reach is None else (max(begin, key - reach[0]), min(end, key + reach[1] + 1))
        together: tuple[int, ...] = (key,)
        while found and found[-1].stop > start:
            last = found.pop()
            start, stop, together = min(start, last.start), max(stop, last.stop), (*last.keys, *together)
        found.append(FrameSpan(start, stop, together))
    return found


# -- planning


def plan_correct(context: PlanContext[PatchesParams]) -> list[Task]:
    """Tasks of the second pass; none without corrected label maps."""
    if context.params.temporal != "on":
        return []
    scan = context.results["scan"]
    keys = {int(key): reach and (reach[0], reach[1]) for key, reach in scan["inputs"]["corrections"].items()}
    tasks: list[Task] = []
    for begin, end in shots(context):
        tasks += _shot_tasks(context, spans(keys, begin, end), begin, end)
    return tasks


def _shot_tasks(context: PlanContext[PatchesParams], found: list[FrameSpan], begin: int, end: int) -> list[Task]:
    shot = [run for run in runs(context) if run[2] == begin]
    tasks: dict[str, Task] = {}
    for span in found:
        touched = [(start, stop) for start, stop, _, _ in shot if start < span.stop and stop > span.start]
        for start, stop in touched:
            if stop > span.keys[0]:
                before = _key("front", span.start, start - RUN)
                tasks[_key("front", span.start, start)] = Task(
                    _key("front", span.start, start), _pass_args(span, start, stop, begin, end),
                    (before,) if before in tasks else (), weight=0.33 * (stop - start),
                )  # fmt: skip
        for start, stop in reversed(touched):
            if start <= span.keys[-1] or span.stop < end:
                behind = _key("back", span.start, start + RUN)
                tasks[_key("back", span.start, start)] = Task(
                    _key("back", span.start, start), _pass_args(span, start, stop, begin, end),
                    (behind,) if behind in tasks else (), weight=0.1 * (stop - start),
                )  # fmt: skip
    for start, stop, _, _ in shot:
        inside = [span for span in found if start < span.stop and stop > span.start]
        if inside:
            args = {"start": start, "stop": stop, "begin": begin, "end": end,
                    "spans": [_blend_args(span, start, stop, begin, end) for span in inside]}  # fmt: skip
            names = [_key(which, span.start, at) for span in inside for which in ("front", "back")
                     for at in (start - RUN, start, start + RUN)]  # fmt: skip
            after = tuple(name for name in names if name in tasks)
            tasks[run_key(start)] = Task(run_key(start), args, after, weight=0.1 * (stop - start))
    return list(tasks.values())


def _key(which: str, span: int, start: int) -> str:
    return f"{which}-{span:07d}-{start:07d}"


def _pass_args(span: FrameSpan, start: int, stop: int, begin: int, end: int) -> TaskResult:
    keys = [key for key in span.keys if start <= key < stop]
    return {"start": start, "stop": stop, "begin": begin, "end": end, "span": [span.start, span.stop], "keys": keys}


def _blend_args(span: FrameSpan, start: int, stop: int, begin: int, end: int) -> TaskResult:
    """The part of a span in one run, with the fixed frames that enclose its frames.

    `fixed` begins with the last fixed frame before the run. A span that ends with the shot has none behind its last
    key.
    """
    first = span.start if span.start == begin else span.start - 1
    fixed = [first, *span.keys, *([span.stop] if span.stop < end else [])]
    low, high = max(0, bisect_right(fixed, start) - 1), bisect_right(fixed, stop - 1) + 1
    keys = [key for key in span.keys if start <= key < stop]
    return {"start": span.start, "stop": span.stop, "first": span.keys[0], "keys": keys, "fixed": fixed[low:high]}


# -- running


def run_correct(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Cluster forward, propagate backward, or blend both passes; artefacts have the form of the step "cluster"."""
    which = task.key.partition("-")[0]
    return {"front": _run_forward, "back": _run_backward, "run": _run_blend}[which](task, context)


def _run_forward(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps of the span's frames in this run, from the run's first frame on.

    New clusters of a span that ends before its shot get numbers that no other cluster of the shot has.
    """
    start, begin, end, keys = (task.args[name] for name in ("start", "begin", "end", "keys"))
    stop, grid = min(task.args["stop"], task.args["span"][1]), WorkingGrid.of(context.size)
    if task.after:
        state = previous_state(context, "correct", task.after[0], task)
    else:
        state = previous_state(context, "cluster", run_key(start - RUN), task)
    if task.args["span"][1] < end:
        last = context.load("cluster", run_key(run_start(end - 1, begin)))
        state.next_label = max(state.next_label, int(last["next"][0]))
    corrected = context.images("labels")
    flow, masks = WindowFlow(context, begin), context.images("masks") if context.has("masks") else {}
    arrays: State = {}
    for index in range(start, stop):
        with context.clock("correct"):
            if index in keys:
                labels = state.restart(index, label_map(corrected[index], grid, index))
            else:
                features = FrameFeatures.of(flow, index, state.begin, context.params)
                labels = next_frame_labels(state, features, masks, context)
        arrays |= label_arrays(index, labels, state)
        context.progress((index + 1 - start) / (stop - start))
    arrays["next"] = np.array([state.next_label, state.begin])
    context.save(task.key, arrays)
    return {}


def _run_backward(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps of the span's frames in this run that have a fixed frame behind them, from the last to the first."""
    begin, keys, (first, behind) = task.args["begin"], task.args["keys"], task.args["span"]
    start, stop = max(task.args["start"], first), min(task.args["stop"], behind)
    flow, grid, corrected = WindowFlow(context, begin), WorkingGrid.of(context.size), context.images("labels")
    labels: Labels | None = None
    if task.after:
        labels = context.load("correct", task.after[0]).get(f"labels-{stop}")
    elif behind < task.args["end"]:
        labels = LabelMaps(context, begin, steps=("cluster",)).require(behind)
    arrays: State = {}
    for index in range(stop - 1, start - 1, -1):
        with context.clock("correct"):
            if index in keys:
                labels = label_map(corrected[index], grid, index)
            elif labels is not None:
                labels = propagate_backward(labels.astype(np.int32), flow, index, context.params)
        if labels is not None:
            arrays |= label_arrays(index, labels)
    context.save(task.key, arrays)
    return {}


def propagate_backward(next_labels: Labels, flow: WindowFlow, index: int, params: PatchesParams) -> Labels:
    """Labels of frame `index`, int32 (h, w), from those of the next frame."""
    motion = frame_motion(flow, index, index)
    if motion.forward is None:
        return next_labels
    forward, reliable = motion.forward
    weights = np.where(reliable >= params.reliable, reliable, 0).astype(np.float32)
    return vote(warp_labels(next_labels, forward)[None], weights[None], edge_weights(motion, params))[0]


def _run_blend(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    start, stop, begin = (task.args[name] for name in ("start", "stop", "begin"))
    flow, draft = WindowFlow(context, begin), LabelMaps(context, begin, steps=("cluster",))
    passes = [_Passes(context, begin, draft, args) for args in task.args["spans"]]
    arrays: State = {}
    statistics: dict[str, LabelRow] = {}
    uncertainty: dict[str, dict[str, float]] = {}
    for index in range(start, stop):
        mine = next((one for one in passes if one.start <= index < one.stop), None)
        if mine is None:
            labels, doubt = draft.require(index), draft.uncertainty(index)
        else:
            with context.clock("correct"):
                labels, doubt = _solved(mine, flow, index, context.params)
        arrays |= label_arrays(index, labels, uncertainty=doubt)
        uncertainty[str(index)] = {str(label): value for label, value in doubt.items()}
        add_label_statistics(statistics, labels, flow.forward(index), index)
        context.progress((index + 1 - start) / (stop - start))
    context.save(task.key, arrays)
    return {"labels": statistics, "uncertainty": uncertainty}


class _Passes:
    """Label maps of the forward and the backward pass over a span, by frame."""

    def __init__(
        self, context: TaskContext[PatchesParams], begin: int, draft: LabelMaps, args: Mapping[str, Any]
    ) -> None:
        self._context, self._begin, self._draft = context, begin, draft
        self.start, self.stop, self.first = (int(args[name]) for name in ("start", "stop", "first"))
        self.keys, self.fixed = (list[int](args[name]) for name in ("keys", "fixed"))
        self._runs: dict[str, State] = {}

    def forward(self, index: int) -> Labels:
        outside = index < self.first or index >= self.stop
        return self._draft.require(index) if outside else self._labels("front", index)

    def backward(self, index: int) -> Labels:
        return self._draft.require(index) if index >= self.stop else self._labels("back", index)

    def _labels(self, which: str, index: int) -> Labels:
        key = _key(which, self.start, run_start(index, self._begin))
        if key not in self._runs:
            self._runs[key] = self._context.load("correct", key)
        return self._runs[key][f"labels-{index}"].astype(np.int32)

    def forward_uncertainty(self, index: int) -> dict[int, float]:
        if index < self.first:
            return self._draft.uncertainty(index)
        self._labels("front", index)
        return stored_uncertainty(self._runs[_key("front", self.start, run_start(index, self._begin))], index)


def _solved(
    passes: _Passes, flow: WindowFlow, index: int, params: PatchesParams
) -> tuple[Labels, dict[int, float]]:  # fmt: skip
    """Labels of a frame of the span, int32 (h, w), and the uncertainty of each."""
    following = bisect_right(passes.fixed, index)
    if index in passes.keys or following == len(passes.fixed):
        return passes.forward(index), passes.forward_uncertainty(index)
    first = passes.fixed[following - 1]
    alpha = (index - first) / (passes.fixed[following] - first)
    return blended_labels(passes, flow, index, alpha, params)


def blended_labels(
    passes: _Passes, flow: WindowFlow, index: int, alpha: float, params: PatchesParams
) -> tuple[Labels, dict[int, float]]:
    """Labels of a frame between two fixed frames, int32 (h, w), and the uncertainty of each label, 0..1.

    Args:
        alpha: relative position of the frame between them, 0..1.

    Source: zhang2011patches, section 4.
    """
    motion = frame_motion(flow, index, index - 1)
    backward, forward = passes.backward(index), passes.forward(index)
    choices = [np.where(backward == forward, backward, 0)]
    weights = [np.where((backward == forward) & (backward > 0), np.float32(SEED_WEIGHT), np.float32(0))]
    for pair, other, weight in ((motion.backward, index - 1, 1 - alpha), (motion.forward, index + 1, alpha)):
        if pair is None:
            continue
        to_other, reliable = pair
        labels = passes.forward(other) if other < index else passes.backward(other)
        choices.append(warp_labels(labels, to_other))
        weights.append(np.where(reliable >= params.reliable, weight * params.interframe * reliable, 0))
    labels, probability = vote(np.stack(choices), np.stack(weights).astype(np.float32), edge_weights(motion, params))
    area = int(labels.size * params.smallest_cluster / 1000)
    labels = absorb_specks(labels, max(area // 12, 4), max(area // 3, 8))
    return labels, uncertainty_of(labels, probability)
