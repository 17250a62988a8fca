"""convert: a finished film unchanged, for another output format.

The platform's own method, for exports of finished jobs; it is not listed among the published ones. Times and sound are
those of the source video.
"""

from __future__ import annotations

from typing import ClassVar

from pipeline.methods.base import (
    AnyParams,
    InputSpec,
    Method,
    Params,
    PlanContext,
    Resources,
    Step,
    Task,
    TaskContext,
    TaskResult,
    resources_per_pixel,
)

CONVERT = "convert"
FILM = "film"
RUN_FRAMES = 96
"""Frames of a task."""
_WEIGHT = 0.05


class ConvertParams(Params):
    """No parameters."""


def plan_convert(context: PlanContext[ConvertParams]) -> list[Task]:
    """Runs of at most RUN_FRAMES frames."""
    first, stop = context.video.first, max(context.video.stop, context.video.first + 1)
    return [
        Task(f"{start:07d}", emits=(start, min(start + RUN_FRAMES, stop)), weight=_WEIGHT * RUN_FRAMES)
        for start in range(first, stop, RUN_FRAMES)
    ]


def run_convert(task: Task, context: TaskContext[ConvertParams]) -> TaskResult:
    """Emit the film's frames. H.264 has added a row and a column to odd sizes, which are cut off again."""
    assert task.emits is not None
    start, stop = task.emits
    width, height = context.size
    film = context.deep_frames(FILM, start - context.video.first, stop - context.video.first)
    for index, _source in enumerate(context.frames("video", start, stop), start=start):
        frame = next(film, None)
        if frame is None:
            break
        context.emit(index, frame[:height, :width])
        context.progress((index + 1 - start) / (stop - start))
    return {}


class Convert(Method):
    """See the module's docstring."""

    name: ClassVar[str] = CONVERT
    title: ClassVar[str] = "Convert"
    summary: ClassVar[str] = "A finished film in another format."
    paper: ClassVar[str] = ""
    Params: ClassVar[type[Params]] = ConvertParams
    opacity_of: ClassVar[str] = FILM
    depth_bits: ClassVar[int] = 32
    inputs: ClassVar[tuple[InputSpec, ...]] = (
        InputSpec("video", "video", True, "Video", "The source of the film: its times and its sound."),
        InputSpec(FILM, "image-or-video", True, "Film", "The finished film, from its first frame on."),
    )
    steps: ClassVar[tuple[Step[AnyParams], ...]] = (Step("convert", "Convert", plan_convert, run_convert, _WEIGHT),)

    def resources(self, step: str, context: PlanContext[ConvertParams]) -> Resources:
        """Peaks measured at 3840x2160 (`python -m benchmarks.task_memory`): 1,018 MiB for 8 bits, 1,452 MiB for
        floating point; plus 20 %."""
        return resources_per_pixel(context.video, 155 if context.deep else 90)
