"""A method of another package: the video with fewer tones."""

from __future__ import annotations

from pipeline.errors import BadInput
from pipeline.methods.base import InputSpec, Method, Params, PlanContext, Step, Task, TaskContext, TaskResult
from pipeline.methods.fields import number


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
    for index, frame in enumerate(context.frames()):
        context.emit(index, frame // step * step + step // 2)
        context.progress(0.5)
    return {}


class Posterize(Method):
    name, title, summary, paper = "posterize", "Posterize", "The video with fewer tones.", "winnemoeller2006realtime"
    Params = PosterizeParams
    inputs = (InputSpec("video", "video", True, "Video", "The video whose tones are reduced."),)
    steps = (
        Step("scan", "Count the frames", lambda context: [Task("video")], count),
        Step("paint", "Paint", plan, paint),
    )
