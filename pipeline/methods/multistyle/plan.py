"""The batch form: looking is a chain, painting is not.

    scan    one pass over the video: how many frames there really are, and where shots begin
    paint   runs of at most RUN_FRAMES frames, two tasks each: `look-n` goes on from the state that the run before it
            saved, and keeps what it saw of every frame; `run-n` paints from that, whenever it likes

Looking costs a fifth of painting, so that the chain of one long shot keeps five workers busy with painting. Shots are
independent of each other. The result is byte for byte what one session over the whole video gives.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pipeline.errors import BadInput
from pipeline.frames import Plane
from pipeline.methods.base import Bench, Brief, Note, Task
from pipeline.methods.multistyle.look import Eye
from pipeline.methods.multistyle.paint import Painter
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.sight import unpack
from pipeline.segmentation.cuts import is_cut, thumbnail

RUN_FRAMES = 16
"""Frames a task: about 3 s of painting at 720p, which is the most a restart repeats. Two workers even out soon."""
LOOKING = 0.2
"""What it costs to look at a frame, where painting it costs 1."""


def plan_scan(brief: Brief) -> list[Task]:
    return [Task("video", weight=0.03 * max(brief.video.frames, 1))]


def run_scan(task: Task, bench: Bench) -> Note:
    """Count the frames and call the cuts, exactly as the eye would."""
    params: MultistyleParams = bench.params
    before: Plane | None = None
    cuts: list[int] = []
    count = 0
    for index, frame in enumerate(bench.frames("video")):
        with bench.clock("cuts"):
            now = thumbnail(frame)
            if before is not None and is_cut(before, now, params.cut_sensitivity):
                cuts.append(index)
        before = now
        count = index + 1
        if index % 16 == 0:
            bench.progress(min(1.0, count / max(bench.video.frames, count)))
    if not count:
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return {"frames": count, "cuts": cuts}


def plan_paint(brief: Brief) -> list[Task]:
    scan = brief.notes["scan"]["video"]
    edges = [0, *scan["cuts"], scan["frames"]]
    looks: list[Task] = []
    paints: list[Task] = []
    for begin, end in pairwise(edges):
        for start in range(begin, end, RUN_FRAMES):
            stop = min(start + RUN_FRAMES, end)
            args = {"start": start, "stop": stop, "last": stop == end}
            after = (_look_key(start - RUN_FRAMES),) if start > begin else ()
            looks.append(Task(_look_key(start), args, after, weight=LOOKING * (stop - start)))
            paints.append(
                Task(f"run-{start:07d}", args, (_look_key(start),), (start, stop), weight=(1 - LOOKING) * (stop - start))
            )
    return looks + paints


def _look_key(start: int) -> str:
    return f"look-{start:07d}"


def run_paint(task: Task, bench: Bench) -> Note:
    return _look(task, bench) if task.emits is None else _paint(task, bench)


def _look(task: Task, bench: Bench) -> Note:
    """Look at frames [start, stop), from the state of the run before where there is one."""
    start, stop = task.args["start"], task.args["stop"]
    eye = Eye(bench.params, bench.size, bench.seed, bench.clock)
    if task.after:
        eye.restore(bench.load("paint", f"state-{task.after[0]}"))
    else:
        eye.age = start
    kept: dict[str, np.ndarray] = {}
    count = 0
    for frame in bench.frames("video", start, stop):
        kept |= {f"{count}.{name}": array for name, array in eye.step(frame).pack().items()}
        count += 1
        bench.progress(count / (stop - start))
    bench.save(task.key, kept)
    if not task.args["last"]:
        bench.save(f"state-{task.key}", eye.state())
    return {"frames": count}


def _paint(task: Task, bench: Bench) -> Note:
    """Paint frames [start, stop) from what was seen of them."""
    start, stop = task.args["start"], task.args["stop"]
    seen = bench.load("paint", task.after[0])
    painter = Painter(bench.params, bench.size, bench.seed, bench.clock)
    count = 0
    for frame in bench.frames("video", start, stop):
        mine = {name.partition(".")[2]: array for name, array in seen.items() if name.startswith(f"{count}.")}
        bench.emit(start + count, painter.paint(frame, unpack(mine)))
        count += 1
        bench.progress(count / (stop - start))
    return {"frames": count}
