"""Step "scan" and the tasks "flow-...": what is in the video, and how everything in a window moves.

Both are shared by all that follows. Flow is computed once for each pair of frames that a window holds, by the run of
frames that the earlier of the two belongs to.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from pipeline.errors import BadInput
from pipeline.flow import estimate
from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.guidance import check, keyframes
from pipeline.methods.patches.links import Pair, pack, reliability, shelf
from pipeline.methods.patches.params import PatchesParams
from pipeline.segmentation.cuts import is_cut, thumbnail

RUN = 12
"""Frames a task, so that there is work for many workers in a short clip."""


def plan_scan(brief: Brief) -> list[Task]:
    return [Task("video", weight=0.02 * max(brief.video.frames, 1))]


def run_scan(task: Task, bench: Bench) -> Note:
    """Count the frames, call the cuts, and look at what the user says."""
    before: Plane | None = None
    cuts: list[int] = []
    count = 0
    for index, frame in enumerate(bench.frames("video")):
        with bench.clock("cuts"):
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, bench.params.cut_sensitivity):
                cuts.append(index)
        before, count = now, index + 1
        if index % 16 == 0:
            bench.progress(min(1.0, count / max(bench.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    check(bench, count)
    return {"frames": count, "cuts": cuts, "keys": keyframes(bench, "labels", count)}


def runs(brief: Brief, length: int = RUN) -> Iterator[tuple[int, int, int, int]]:
    """(start, stop, shot's begin, shot's end) of every run of frames, in order; none crosses a cut."""
    scan = brief.notes["scan"]["video"]
    for begin, end in pairwise([0, *scan["cuts"], scan["frames"]]):
        for start in range(begin, end, length):
            yield start, min(start + length, end), begin, end


def run_key(start: int) -> str:
    return f"run-{start:07d}"


def flow_key(start: int) -> str:
    return f"flow-{start:07d}"


def run_of(frame: int, begin: int) -> int:
    """Start of the run that a frame is in; `begin` is its shot's."""
    return begin + (frame - begin) // RUN * RUN


def run_flow(task: Task, bench: Bench) -> Note:
    """Flow and reliability of all pairs (i, i + k), i in [start, stop), k < window, within the shot."""
    params: PatchesParams = bench.params
    reach = (params.window if params.temporal == "on" else 2) - 1
    start, stop, begin, end = (task.args[name] for name in ("start", "stop", "begin", "end"))
    shelves: dict[str, dict[str, np.ndarray]] = {shelf(stop - 1, 1, begin, RUN): {}}
    grid, queue = Grid.of(bench.size), list[tuple[Frame, Frame]]()
    source = bench.frames("video", start, min(stop + reach, end))
    for index in range(start, stop):
        while len(queue) <= reach and (more := next(source, None)) is not None:
            queue.append((more, grid.small(more)))
        shelves.setdefault(shelf(index, 0, begin, RUN), {})[f"small-{index}"] = queue[0][1]
        for gap in range(1, len(queue)):
            with bench.clock("flow"):
                pair = link(queue[0], queue[gap], gap, grid, params)
            for name, array in pack(pair, index, gap).items():
                where = shelf(index, 0 if name[0] in "ft" else gap, begin, RUN)
                shelves.setdefault(where, {})[name] = array
        queue.pop(0)
        bench.progress((index + 1 - start) / (stop - start))
    for name, kept in shelves.items():
        bench.save(name, kept)
    return {}


def link(first: tuple[Frame, Frame], second: tuple[Frame, Frame], gap: int, grid: Grid, params: PatchesParams) -> Pair:
    """Flow both ways between two frames (each at full and working size), and how far it can be trusted.

    Neighbours in time are linked at full size, since their flow moves the strokes; others at the working size.
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
