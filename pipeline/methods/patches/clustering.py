"""Step "cluster": label maps of all frames, with labels that are consistent over a shot.

    flow-<run>   optical flow between the frames of each window
    run-<run>    label maps; each run continues from the previous one, so labels need no matching afterwards
    faces-<run>  faces, tracked from run to run in the same way

Flow tasks are parallel and cost about twice as much as the label tasks, which form a chain. All belong to one step, so
that workers compute flow while one worker follows the chain. Label maps that the user has corrected have no part in
this step: see `correction`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

import numpy as np

from pipeline.arrays import AnyArray, Arrays, State
from pipeline.frames import Labels
from pipeline.kernels.ahead import ahead, helpers
from pipeline.kernels.executors import INLINE, FrameExecutor, Pending
from pipeline.methods.base import FrameClusters, PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.face_tracking import faces_key, run_faces
from pipeline.methods.patches.motion_clustering import ClusterState, FrameFeatures, cluster_frame
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.patch_track import LabelRow, add_label_statistics
from pipeline.methods.patches.scan import RUN, WorkingGrid, mask_map, run_key, run_start, runs
from pipeline.methods.patches.window_flow import WindowFlow, flow_key, run_flow


def plan_cluster(context: PlanContext[PatchesParams]) -> list[Task]:
    """Tasks per run of frames: flow; with patches, labels and faces; none for independent frames."""
    params = context.params
    if params.temporal == "off":
        return []
    tasks, chain = list[Task](), list[Task]()
    for start, stop, begin, end in runs(context):
        args = {"start": start, "stop": stop, "begin": begin, "end": end}
        tasks.append(Task(flow_key(start), args, weight=0.57 * (stop - start)))
        tasks += chain
        chain = [_label_task(args)]
        if params.face_detail > 0:
            chain.append(_faces_task(args))
    return tasks + chain


def _faces_task(args: dict[str, int]) -> Task:
    start, previous = args["start"], args["start"] - RUN
    after = [flow_key(start)] + ([flow_key(previous), faces_key(previous)] if start > args["begin"] else [])
    return Task(faces_key(start), args, tuple(after), weight=0.08 * (args["stop"] - start))


def _label_task(args: dict[str, int]) -> Task:
    start, previous = args["start"], args["start"] - RUN
    after = [flow_key(start)] + ([flow_key(previous), run_key(previous)] if start > args["begin"] else [])
    return Task(run_key(start), args, tuple(after), weight=0.31 * (args["stop"] - start))


def run_cluster(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute flow, label maps or faces, see `run_flow`, `run_labels` and `run_faces` for the artefacts."""
    steps: Mapping[str, Callable[[Task, TaskContext[PatchesParams]], TaskResult]] = {
        "flow": run_flow, "run": run_labels, "faces": run_faces,
    }  # fmt: skip
    return steps[task.key.partition("-")[0]](task, context)


def run_labels(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Label maps of frames [start, stop), see `label_arrays`.

    The result has the statistics of each label, see `LabelRow`, and the uncertainty of each label in each frame, 0..1.
    """
    start, stop, begin = task.args["start"], task.args["stop"], task.args["begin"]
    flow, state = WindowFlow(context, begin), previous_state(context, "cluster", run_key(start - RUN), task)
    masks = context.images("masks") if context.has("masks") else {}
    arrays: State = {}
    statistics: dict[str, LabelRow] = {}
    uncertainty: dict[str, dict[str, float]] = {}

    def features(index: int) -> FrameFeatures:
        with context.clock("features"):
            return FrameFeatures.of(flow, index, begin, context.params)

    with helpers(1, "impasto-labels") as threads, ahead(features, range(start, stop), 1, "impasto-features") as known:
        background, counted = FrameExecutor(threads), list[Pending[None]]()
        for own in known:
            with context.clock("cluster"):
                labels = next_frame_labels(state, own, masks, context, background)
            arrays |= label_arrays(own.index, labels, state)
            uncertainty[str(own.index)] = {str(label): value for label, value in state.uncertainty.items()}
            counted.append(background(add_label_statistics, statistics, labels, own.motion.forward, own.index))
            context.progress((own.index + 1 - start) / (stop - start))
        for each in counted:
            each.result()
    arrays["next"] = np.array([state.next_label, state.begin])
    context.save(task.key, arrays)
    return {"labels": statistics, "uncertainty": uncertainty}


def next_frame_labels(
    state: ClusterState, features: FrameFeatures, masks: Mapping[int, AnyArray], context: TaskContext[PatchesParams],
    background: FrameExecutor = INLINE,
) -> Labels:  # fmt: skip
    """Labels of a frame, int32 (h, w), from the state after the frame before it.

    Args:
        masks: the user's foreground masks by frame, as stored.
        background: its helper takes a part of the work.
    """
    index = features.index
    mask = mask_map(masks[index], WorkingGrid.of(context.size), index) if index in masks else None
    return cluster_frame(state, features, context.params, mask, background)


def previous_state(context: TaskContext[PatchesParams], step: str, key: str, task: Task) -> ClusterState:
    """State after the run before the task's, which the task `key` of `step` has saved; at the shot's first run, the
    initial state."""
    if task.args["start"] == task.args["begin"]:
        return ClusterState(begin=task.args["begin"])
    arrays = context.load(step, key)
    maps, foregrounds = (
        {int(key.removeprefix(kind)): value.astype(np.int32) for key, value in arrays.items() if key.startswith(kind)}
        for kind in ("labels-", "foreground-")
    )
    next_label, begin = (int(value) for value in arrays["next"])
    state = ClusterState({key: value for key, value in maps.items() if key >= begin}, foregrounds, next_label, begin)
    state.trim(task.args["start"] - 1, context.params.window)
    return state


def label_arrays(
    index: int, labels: Labels, state: ClusterState | None = None, uncertainty: Mapping[int, float] | None = None
) -> State:
    """Arrays of a frame's labels for storage: "labels-<frame>" and, if they are known, "foreground-<frame>" and
    "uncertainty-<frame>" (rows of label and uncertainty).

    Args:
        state: after this frame.
        uncertainty: instead of the state's.
    """
    arrays: State = {f"labels-{index}": stored_labels(labels)}
    if state is not None and index in state.foregrounds:
        arrays[f"foreground-{index}"] = state.foregrounds[index].astype(np.uint8)
    doubt = uncertainty if uncertainty is not None else state.uncertainty if state is not None else None
    if doubt is not None:
        arrays[f"uncertainty-{index}"] = np.array(sorted(doubt.items()), np.float64).reshape(-1, 2)
    return arrays


def stored_uncertainty(arrays: Arrays, index: int) -> dict[int, float]:
    """Uncertainty of each label of a frame, 0..1, from the arrays of `label_arrays`."""
    return {int(label): float(value) for label, value in arrays[f"uncertainty-{index}"]}


def stored_clusters(arrays: Arrays) -> dict[int, FrameClusters]:
    """Clusters by frame, from the arrays of `label_arrays` of a run of frames."""
    found: dict[int, FrameClusters] = {}
    for name in arrays:
        kind, _, number = name.partition("-")
        if kind == "labels":
            index = int(number)
            foreground = arrays.get(f"foreground-{index}")
            found[index] = FrameClusters(
                np.asarray(arrays[name], np.int32), stored_uncertainty(arrays, index),
                None if foreground is None else np.asarray(foreground == 2),
            )  # fmt: skip
    return found


def stored_labels(labels: Labels) -> AnyArray:
    """Convert labels for storage: uint8 if they fit, else uint16. All later tasks read these arrays."""
    return labels.astype(np.uint8 if labels.max(initial=0) < 256 else np.uint16)


class LabelMaps:
    """Reads the label maps of a shot.

    Args:
        begin: first frame of the shot.
        max_runs: number of runs held in memory.
        steps: steps whose maps count, in this order: the final labels of a run are those of the step "correct" if it
            has solved the run again, else those of "cluster".
    """

    def __init__(
        self, context: TaskContext[PatchesParams], begin: int, max_runs: int = 3,
        steps: Sequence[str] = ("correct", "cluster"),
    ) -> None:  # fmt: skip
        self._context, self._begin, self._max_runs, self._steps = context, begin, max_runs, steps
        self._runs: dict[int, State] = {}

    def __call__(self, index: int) -> Labels | None:
        """Label map of frame `index`: int32 (h, w) at the working size; None before the shot."""
        return None if index < self._begin else self._run(index)[f"labels-{index}"].astype(np.int32)

    def require(self, index: int) -> Labels:
        """Label map of a frame that is in the shot: int32 (h, w)."""
        found = self(index)
        assert found is not None
        return found

    def uncertainty(self, index: int) -> dict[int, float]:
        """Uncertainty of each label in a frame of the shot, 0..1."""
        return stored_uncertainty(self._run(index), index)

    def _run(self, index: int) -> State:
        start = run_start(index, self._begin)
        if start not in self._runs:
            self._runs[start] = self._loaded(run_key(start))
            while len(self._runs) > self._max_runs:
                del self._runs[next(iter(self._runs))]
        return self._runs[start]

    def _loaded(self, key: str) -> State:
        for step in self._steps[:-1]:
            with suppress(KeyError):
                return self._context.load(step, key)
        return self._context.load(self._steps[-1], key)
