"""Steps "cluster" and "correct": label maps of all frames, with labels that are consistent over a shot.

Step "cluster":

    flow-<run>   optical flow between the frames of each window
    run-<run>    label maps; each run continues from the previous one, so labels need no matching afterwards

Flow tasks are parallel and cost about twice as much as the label tasks, which form a chain. Both belong to one step, so
that workers compute flow while one worker follows the chain.

Step "correct" clusters the frames between keyframes with corrected label maps again (section 4 of zhang2011patches,
second pass). Without corrected label maps it has no tasks:

    back-<run>   labels propagated backward from the next keyframe
    run-<run>    blend of both passes: pixels where they agree are seeds; elsewhere links to the previous frame have
                 weight 1 - alpha and links to the next frame alpha, which grows from 0 to 1 between the keyframes
"""

from __future__ import annotations

import json
from bisect import bisect_right

import numpy as np

from pipeline.arrays import AnyArray, State
from pipeline.frames import Labels
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.artefacts import LABELS
from pipeline.methods.patches.motion_clustering import (
    ClusterState,
    cluster_frame,
    edge_weights,
    frame_motion,
    warp_labels,
)
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import LabelRow, add_label_statistics
from pipeline.methods.patches.scan import RUN, WorkingGrid, label_map, mask_map, run_key, run_start, runs
from pipeline.methods.patches.window_flow import WindowFlow, flow_key, run_flow
from pipeline.segmentation.components import absorb_specks
from pipeline.segmentation.random_walk import vote

SEED_WEIGHT = 5.0
"""Weight of the seeds, where forward and backward labels agree."""

# -- step "cluster"


def plan_cluster(context: PlanContext[PatchesParams]) -> list[Task]:
    """A flow task and a label task per run of frames; flow only for advected strokes; none for independent frames."""
    if context.params.temporal == "off":
        return []
    tasks, chain = list[Task](), list[Task]()
    for start, stop, begin, end in runs(context):
        args = {"start": start, "stop": stop, "begin": begin, "end": end}
        tasks.append(Task(flow_key(start), args, weight=0.3 * (stop - start)))
        tasks += chain
        chain = [_label_task(args)] if context.params.temporal == "on" else []
    return tasks + chain


def _label_task(args: dict[str, int]) -> Task:
    start, previous = args["start"], args["start"] - RUN
    after = [flow_key(start)] + ([flow_key(previous), run_key(previous)] if start > args["begin"] else [])
    return Task(run_key(start), args, tuple(after), weight=0.15 * (args["stop"] - start))


def run_cluster(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute flow or label maps, see `run_flow` and `run_labels` for the artefacts."""
    return run_flow(task, context) if task.key.startswith("flow") else run_labels(task, context)


def run_labels(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps "labels-<frame>" of frames [start, stop).

    The result has the statistics of each label, see `LabelRow`, and the uncertainty of each label in each frame, 0..1,
    which is also saved as the file "uncertainty-<run>.json" with the artefact "labels".
    """
    params = context.params
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    flow, grid = WindowFlow(context, begin), WorkingGrid.of(context.size)
    state = _previous_state(context, task, params)
    corrected = context.images("labels") if context.has("labels") else {}
    masks = context.images("masks") if context.has("masks") else {}
    arrays: State = {}
    statistics: dict[str, LabelRow] = {}
    uncertainty: dict[str, dict[str, float]] = {}
    for index in range(start, stop):
        with context.clock("cluster"):
            if index in corrected:
                labels = state.restart(index, label_map(corrected[index], grid, index))
            else:
                user_mask = mask_map(masks[index], grid, index) if index in masks else None
                labels = cluster_frame(state, flow, index, params, user_mask)
        arrays[f"labels-{index}"] = stored_labels(labels)
        if index in state.foregrounds:
            arrays[f"foreground-{index}"] = state.foregrounds[index].astype(np.uint8)
        uncertainty[str(index)] = {str(label): value for label, value in state.uncertainty.items()}
        add_label_statistics(statistics, labels, flow, index)
        context.progress((index + 1 - start) / (stop - start))
    arrays["next"] = np.array([state.next_label, state.begin])
    context.save(task.key, arrays)
    if context.wants(LABELS):
        context.save_file(f"uncertainty-{task.key}.json", json.dumps(uncertainty).encode(), "application/json")
    return {"labels": statistics, "uncertainty": uncertainty}


def _previous_state(context: TaskContext[PatchesParams], task: Task, params: PatchesParams) -> ClusterState:
    """State after the previous run of the shot, or the initial state."""
    if task.args["start"] == task.args["begin"]:
        return ClusterState(begin=task.args["begin"])
    arrays = context.load("cluster", run_key(task.args["start"] - RUN))
    maps, foregrounds = (
        {int(key.removeprefix(kind)): value.astype(np.int32) for key, value in arrays.items() if key.startswith(kind)}
        for kind in ("labels-", "foreground-")
    )
    next_label, begin = (int(value) for value in arrays["next"])
    state = ClusterState({key: value for key, value in maps.items() if key >= begin}, foregrounds, next_label, begin)
    state.trim(task.args["start"] - 1, params.window)
    return state


def stored_labels(labels: Labels) -> AnyArray:
    """Convert labels for storage: uint8 if they fit, else uint16. All later tasks read these arrays."""
    return labels.astype(np.uint8 if labels.max(initial=0) < 256 else np.uint16)


class LabelMaps:
    """Reads the final label maps of a shot: of the step "correct" if it has run, else of "cluster".

    Args:
        begin: first frame of the shot.
        max_runs: number of runs held in memory.
    """

    def __init__(self, context: TaskContext[PatchesParams], begin: int, max_runs: int = 3) -> None:
        self._context, self._begin, self._max_runs = context, begin, max_runs
        self._runs: dict[int, State] = {}
        self._step = "correct" if context.has("labels") else "cluster"

    def __call__(self, index: int) -> Labels | None:
        """Label map of frame `index`: int32 (h, w) at the working size; None before the shot."""
        if index < self._begin:
            return None
        start = run_start(index, self._begin)
        if start not in self._runs:
            self._runs[start] = self._context.load(self._step, run_key(start))
            while len(self._runs) > self._max_runs:
                del self._runs[next(iter(self._runs))]
        return self._runs[start][f"labels-{index}"].astype(np.int32)

    def require(self, index: int) -> Labels:
        """Label map of a frame that is in the shot: int32 (h, w)."""
        found = self(index)
        assert found is not None
        return found


# -- step "correct"


def plan_correct(context: PlanContext[PatchesParams]) -> list[Task]:
    """Tasks of the second pass; none without corrected label maps."""
    if context.params.temporal != "on" or "labels" not in context.inputs:
        return []
    all_keys = context.results["scan"]["video"]["keys"]
    tasks, backward = list[Task](), set[int]()
    for start, stop, begin, end in reversed(list(runs(context))):
        keys = [key for key in all_keys if begin <= key < end]
        args = {"start": start, "stop": stop, "begin": begin, "end": end, "keys": keys}
        if any(key >= start for key in keys):
            after = (_backward_key(start + RUN),) if start + RUN in backward and start + RUN < end else ()
            tasks.append(Task(_backward_key(start), args, after, weight=0.05 * (stop - start)))
            backward.add(start)
        needs = tuple(_backward_key(at) for at in (start, start + RUN) if at in backward and at < end)
        tasks.append(Task(run_key(start), args, needs, weight=0.05 * (stop - start)))
    return tasks


def _backward_key(start: int) -> str:
    return f"back-{start:07d}"


def run_correct(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Propagate labels backward, or blend both passes; artefacts have the form of the step "cluster"."""
    return _run_backward(task, context) if task.key.startswith("back") else _run_blend(task, context)


def _run_backward(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps "labels-<frame>" of the frames that have a keyframe at or after them, from the last to the first."""
    start, stop, keys = task.args["start"], task.args["stop"], task.args["keys"]
    flow, corrected, grid = (
        WindowFlow(context, task.args["begin"]),
        context.images("labels"),
        WorkingGrid.of(context.size),
    )
    labels = context.load("correct", task.after[0]).get(f"labels-{stop}") if task.after else None
    arrays: State = {}
    for index in range(stop - 1, start - 1, -1):
        if index in keys:
            labels = label_map(corrected[index], grid, index)
        elif labels is not None:
            with context.clock("correct"):
                labels = propagate_backward(labels.astype(np.int32), flow, index, context.params)
        if labels is not None:
            arrays[f"labels-{index}"] = stored_labels(labels)
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
    start, stop, begin, keys = (task.args[name] for name in ("start", "stop", "begin", "keys"))
    flow, passes = WindowFlow(context, begin), _LabelPasses(context, begin)
    arrays: State = {}
    statistics: dict[str, LabelRow] = {}
    for index in range(start, stop):
        following = bisect_right(keys, index)
        if index in keys or following == len(keys):
            labels = passes.forward(index)
        else:
            first = keys[following - 1] if following else begin
            alpha = (index - first) / (keys[following] - first)
            with context.clock("correct"):
                labels = blended_labels(passes, flow, index, alpha, context.params)
        arrays[f"labels-{index}"] = stored_labels(labels)
        add_label_statistics(statistics, labels, flow, index)
    context.save(task.key, arrays)
    return {"labels": statistics}


class _LabelPasses:
    """Label maps of the forward and the backward pass, by frame."""

    def __init__(self, context: TaskContext[PatchesParams], begin: int) -> None:
        self._context, self._begin = context, begin
        self._runs: dict[tuple[str, str], State] = {}

    def forward(self, index: int) -> Labels:
        return self._labels("cluster", run_key(run_start(index, self._begin)), index)

    def backward(self, index: int) -> Labels:
        return self._labels("correct", _backward_key(run_start(index, self._begin)), index)

    def _labels(self, step: str, key: str, index: int) -> Labels:
        if (step, key) not in self._runs:
            self._runs[step, key] = self._context.load(step, key)
        return self._runs[step, key][f"labels-{index}"].astype(np.int32)


def blended_labels(
    passes: _LabelPasses, flow: WindowFlow, index: int, alpha: float, params: PatchesParams
) -> Labels:  # fmt: skip
    """Labels of a frame between two keyframes: int32 (h, w). `alpha`, 0..1, is its relative position between them.

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
    labels, _ = vote(np.stack(choices), np.stack(weights).astype(np.float32), edge_weights(motion, params))
    area = int(labels.size * params.smallest_cluster / 1000)
    return absorb_specks(labels, max(area // 12, 4), max(area // 3, 8))
