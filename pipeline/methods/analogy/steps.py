"""Entry points of the steps `synthesise` and `composite`."""

from __future__ import annotations

import numpy as np

from pipeline.frames import Frame
from pipeline.methods.analogy.keyed_synthesizer import run_interval
from pipeline.methods.analogy.layer_source import source_of
from pipeline.methods.analogy.layers import layered_shot, paint_name
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.plan import SweepTask
from pipeline.methods.analogy.synthesizer import STEP, Synthesizer
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.synthesis.images import Bytes


def run_synthesis(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Run a task of the step `synthesise`: sweeps over a run of frames, independent frames, or an interval between
    keys."""
    if "interval" in task.args:
        return run_interval(task, context)
    args = dict(task.args)
    earlier = [(key, SweepTask(**each)) for key, each in args.pop("before", [])]
    job = SweepTask(**args)
    synthesizer = Synthesizer(context, source_of(context, job.layer))
    synthesizer.run_sweeps([*earlier, (task.key, job)])
    return synthesizer.result(job.stop - job.start)


def run_composite(task: Task, context: TaskContext[AnalogyParams]) -> TaskResult:
    """Lay the painted layers of a run of frames over the background colour of shot.json; emit the frames."""
    assert task.emits is not None
    shot = layered_shot(context)
    assert shot is not None
    start, stop = task.emits
    for index in range(start, stop):
        canvas = plain(context.size, shot.says.background)
        for layer in range(task.args["layers"]):
            painted = context.load(STEP, paint_name(layer, index))["rgba"]
            with context.clock("composite"):
                canvas = over(painted, canvas)
        context.emit(index, canvas)
        context.progress((index + 1 - start) / (stop - start))
    return {"frames": stop - start}


def plain(size: tuple[int, int], colour: str) -> Frame:
    """A canvas of one colour "#rrggbb", uint8 (h, w, 3)."""
    return np.full((size[1], size[0], 3), list(bytes.fromhex(colour[1:])), np.uint8)


def over(painted: Bytes, below: Frame) -> Frame:
    """Composite straight-alpha RGBA over a frame, rounded to nearest; opaque pixels are copied exactly."""
    alpha = painted[..., 3:].astype(np.uint16)
    mixed = painted[..., :3].astype(np.uint16) * alpha + below.astype(np.uint16) * (255 - alpha) + 127
    return np.asarray(mixed // 255, np.uint8)
