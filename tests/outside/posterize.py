"""A method of another package: the video with fewer tones, but for what the user marks.

It has all that a built-in method may have in the studio: a section with marks, whose part of the layer is an input.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.frames import Frame
from pipeline.methods.base import (
    InputSpec,
    LayerPart,
    Method,
    Params,
    PlanContext,
    Step,
    Studio,
    Task,
    TaskContext,
    TaskResult,
)
from pipeline.methods.fields import number
from pipeline.methods.parts import Drawings
from pipeline.methods.studio import Mark, Section


class PosterizeParams(Params):
    tones: float = number(4, 2, 64, "Tones", "Number of levels of each channel.", "levels", "Colour")


def count(task: Task, context: TaskContext[PosterizeParams]) -> TaskResult:
    if not (frames := sum(1 for _ in context.frames())):
        raise BadInput("The video has no frames.", field="inputs.video", remedy="Upload a video that plays.")
    return {"frames": frames}


def plan(context: PlanContext[PosterizeParams]) -> list[Task]:
    return [Task("all", emits=(0, context.results["scan"]["video"]["frames"]))]


def paint(task: Task, context: TaskContext[PosterizeParams]) -> TaskResult:
    step = 256 // int(context.params.tones)
    stencils = context.images("stencils") if context.has("stencils") else {}
    stencil: AnyArray | None = None
    for index, frame in enumerate(context.frames()):
        stencil = stencils.get(index, stencil)
        flat = frame // step * step + step // 2
        context.emit(index, flat if stencil is None else stencilled(frame, flat, stencil))
        context.progress(0.5)
    return {}


def stencilled(frame: Frame, flat: Frame, stencil: AnyArray) -> Frame:
    """The flat frame; the frame itself where the stencil is green, black where it is blue."""
    drawn = stencil[..., 3:] > 127
    kept, dark = drawn & (stencil[..., 1:2] > 127), drawn & (stencil[..., 2:3] > 127)
    return np.where(kept, frame, np.where(dark, 0, flat)).astype(np.uint8)


class Posterize(Method):
    name, title, summary, paper = "posterize", "Posterize", "The video with fewer tones.", "winnemoeller2006realtime"
    Params = PosterizeParams
    inputs = (
        InputSpec("video", "video", True, "Video", "The video whose tones are reduced."),
        InputSpec(
            "stencils", "images", False, "Stencils", "Green keeps the video, blue is black; each until the next.",
            "stencil.image",
        ),
    )  # fmt: skip
    steps = (
        Step("scan", "Count the frames", lambda context: [Task("video")], count),
        Step("paint", "Paint", plan, paint),
    )
    parts: ClassVar[tuple[LayerPart, ...]] = (LayerPart("stencil", "Stencil", Drawings),)
    studio: ClassVar[Studio] = Studio(
        sections=(
            Section(
                "marks", "stencil", "Stencil", "What is marked keeps its tones, or becomes black, from this frame on.",
                marks=(Mark("Kept part", "#00ff00"), Mark("Dark part", "#0000ff")),
            ),
        ),
        tools=("brush", "eraser"),
    )  # fmt: skip
