"""Step "scan" (frame count and cuts), and the tasks "flow-..." (optical flow between the frames of a window).

Flow is computed once for each pair of frames in a window, by the run that contains the earlier frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from pipeline.flow import estimate
from pipeline.frames import Flow, Frame
from pipeline.methods.base import PlanContext, Task, TaskContext, TaskResult
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import check, keyframes
from pipeline.methods.patches.links import Pair, artefact_of, pack, reliability
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.scan import scan_video

RUN = 12
"""Frames per task. It is small, so that short clips can use many workers."""


def plan_scan(context: PlanContext[PatchesParams]) -> list[Task]:
    return [Task("video", weight=0.02 * max(context.video.frames, 1))]


def run_scan(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Result: number of frames, cuts, and the frames with corrected labels. Checks the user's inputs."""
    count, cuts = scan_video(context, context.params.cut_sensitivity)
    check(context, count)
    return {"frames": count, "cuts": cuts, "keys": keyframes(context, "labels", count)}


def runs(context: PlanContext[PatchesParams], length: int = RUN) -> Iterator[tuple[int, int, int, int]]:
    """(start, stop, shot's begin, shot's end) of every run of frames, in order; none crosses a cut."""
    scan = context.results["scan"]["video"]
    for begin, end in pairwise([0, *scan["cuts"], scan["frames"]]):
        for start in range(begin, end, length):
            yield start, min(start + length, end), begin, end


def run_key(start: int) -> str:
    return f"run-{start:07d}"


def flow_key(start: int) -> str:
    return f"flow-{start:07d}"


def run_of(frame: int, begin: int) -> int:
    """First frame of the run that contains `frame`; `begin` is the first frame of the shot."""
    return begin + (frame - begin) // RUN * RUN


def run_flow(task: Task, context: TaskContext[PatchesParams]) -> TaskResult:
    """Compute flow and reliability of all pairs (i, i + k) in the shot, for i in [start, stop) and 1 <= k < window."""
    params = context.params
    reach = (params.window if params.temporal == "on" else 2) - 1
    start, stop, begin, end = (task.args[name] for name in ("start", "stop", "begin", "end"))
    artefacts: dict[str, dict[str, np.ndarray]] = {artefact_of(stop - 1, 1, begin, RUN): {}}
    grid, queue = Grid.of(context.size), list[tuple[Frame, Frame]]()
    source = context.frames("video", start, min(stop + reach, end))
    for index in range(start, stop):
        while len(queue) <= reach and (more := next(source, None)) is not None:
            queue.append((more, grid.small(more)))
        artefacts.setdefault(artefact_of(index, 0, begin, RUN), {})[f"small-{index}"] = queue[0][1]
        for gap in range(1, len(queue)):
            with context.clock("flow"):
                pair = link(queue[0], queue[gap], gap, grid, params)
            for name, array in pack(pair, index, gap).items():
                where = artefact_of(index, 0 if name[0] in "ft" else gap, begin, RUN)
                artefacts.setdefault(where, {})[name] = array
        queue.pop(0)
        context.progress((index + 1 - start) / (stop - start))
    for name, kept in artefacts.items():
        context.save(name, kept)
    return {}


def link(first: tuple[Frame, Frame], second: tuple[Frame, Frame], gap: int, grid: Grid, params: PatchesParams) -> Pair:
    """Forward and backward flow between two frames, and the reliability of each.

    Flow between consecutive frames is computed at full size, since it moves the strokes; over larger gaps, at the
    working size.

    Args:
        first, second: each frame at full size and at the working size.
    """
    size = 0 if gap == 1 else 1
    ahead: Flow = estimate(first[size], second[size], params.flow)
    back: Flow = estimate(second[size], first[size], params.flow)
    if gap == 1:
        ahead, back = grid.shrink_flow(ahead), grid.shrink_flow(back)
    there = reliability(first[1], second[1], ahead, back, params.colour_scale)
    home = reliability(second[1], first[1], back, ahead, params.colour_scale)
    return Pair(ahead, back, there, home)


__all__ = ["RUN", "flow_key", "link", "plan_scan", "run_flow", "run_key", "run_of", "run_scan", "runs"]
