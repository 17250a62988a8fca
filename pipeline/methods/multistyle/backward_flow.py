"""Optical flow from a frame to the one before it, which depends on the source only: computed by tasks of their own
before the analysis, or by the analysis itself.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import State
from pipeline.frames import Flow, Frame
from pipeline.methods.base import Task, TaskContext, TaskResult
from pipeline.methods.given_motion import given_motion
from pipeline.methods.multistyle.denoise import zero_still_flow_by_texture
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.prepared import costs_more
from pipeline.perception.flow import FlowMethod, estimate

HALVED_FROM_PX = 400
"""Shorter side, px, of the frames that are analysed at half resolution; strokes are wider than the lost detail."""
BYTES_PER_PX = 8
"""Size of a flow."""
COST_NS_PER_PX: dict[FlowMethod, float] = {"dis-ultrafast": 10, "dis-fast": 24, "dis-medium": 115, "tvl1": 1000}
"""Processor time of a flow with `zero_still_flow_by_texture`, for each pixel of the working size."""


def working_size(size: tuple[int, int]) -> tuple[int, int]:
    """(width, height) at which frames of `size` are analysed, px."""
    halved = 2 if min(size) >= HALVED_FROM_PX else 1
    return size[0] // halved, size[1] // halved


def is_prepared(params: MultistyleParams, size: tuple[int, int]) -> bool:
    """Whether tasks of their own compute the flow of a job with frames of `size` (width, height) px."""
    if params.temporal == "off":
        return False
    width, height = working_size(size)
    work = width * height
    return costs_more(COST_NS_PER_PX[params.flow] * work, BYTES_PER_PX * work, size[0] * size[1])


def gray_of(frame: Frame) -> NDArray[np.uint8]:
    """uint8 (h, w)."""
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)


def downscaled(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """The picture at `size` (width, height), not larger than it."""
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def backward_flow(before: NDArray[np.uint8], now: NDArray[np.uint8], params: MultistyleParams) -> Flow:
    """Flow from `now` to `before`, float32 (h, w, 2), px, exactly 0 where nothing moves.

    Args:
        before, now: uint8 (h, w), gray, at the working size.
    """
    return zero_still_flow_by_texture(estimate(now, before, params.flow), now, before, params.stillness)


def run_flow(task: Task, context: TaskContext[MultistyleParams]) -> TaskResult:
    """Save the flow of the frames [start, stop) as the artefact of the task's key, by frame number. The first frame of
    a shot has none, and frames whose motion is given need none."""
    params, work = context.params.effective, working_size(context.size)
    start, stop = task.args["start"], task.args["stop"]
    motion, flows = given_motion(context), State()
    before: NDArray[np.uint8] | None = None
    first = start if task.args["first"] else start - 1
    for number, frame in enumerate(context.frames("video", first, stop), first):
        now = downscaled(gray_of(frame), work)
        if before is not None and motion.flow(number, number - 1, work) is None:
            with context.clock("flow"):
                flows[str(number)] = backward_flow(before, now, params)
        before = now
        context.progress((number + 1 - first) / (stop - first))
    context.save(task.key, flows)
    return {}
