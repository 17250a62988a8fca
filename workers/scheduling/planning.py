"""Planning: the tasks of a job's next step, checked. Independent of the store and the pool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from pipeline.methods import method, parse_params
from pipeline.methods.base import Method, Params, PlanContext, Task, TaskResult, VideoInfo, resources_per_pixel
from pipeline.methods.plan_check import check_plan
from workers.contract.request import JobRequest, Json
from workers.jobs.frame_window import video_info
from workers.jobs.plan_versions import StepVersion
from workers.jobs.state_machine import ASSEMBLE

_ASSEMBLE_TITLE = "Join frames and sound"
_ASSEMBLE_VERSION = 1
"""See `pipeline.methods.base.Step.version`."""
_ASSEMBLE_S = 0.001
"""Processor time of a frame, seconds."""
_LEAST_PIXELS = 100_000
"""Pixels of a frame from which the time of painting depends on them."""
_ASSEMBLE_BYTES = 210.0
"""A pixel: a few decoded frames for the poster and the contact sheet. `python -m benchmarks.task_memory` at 3840x2160:
1,143 MiB (8 bits), 1,436 MiB (floating point), at most 1,814 MiB in a process that has painted before; plus 20 %."""


def steps_of(chosen: Method, params: Params) -> tuple[tuple[str, str], ...]:
    """(name, title) of a job's steps: the method's, then the platform's own."""
    return (*((step.name, step.title) for step in chosen.steps_of(params)), (ASSEMBLE, _ASSEMBLE_TITLE))


def step_versions(chosen: Method, params: Params | None) -> tuple[StepVersion, ...]:
    """Versions of `steps_of`. `params`: None if the stored ones are those of another version."""
    steps = chosen.steps if params is None else chosen.steps_of(params)
    own = (StepVersion(step.name, step.version, step.reads) for step in steps)
    return (*own, StepVersion(ASSEMBLE, _ASSEMBLE_VERSION))


def versions_of(chosen: Method, params: Params) -> list[tuple[str, int]]:
    """The same as they are stored."""
    return [(step.name, step.version) for step in step_versions(chosen, params)]


def expected_weights(chosen: Method, params: Params, info: Json) -> tuple[float, ...]:
    """Expected weight of each of `steps_of`, as far as it can be known of a video before planning."""
    video = video_info(info)
    frames = max(1, video.frames)
    painting_s = chosen.cpu_s_per_megapixel * max(video.width * video.height, _LEAST_PIXELS) / 1e6
    return (*(frames * step.weight for step in chosen.steps_of(params)), frames * _ASSEMBLE_S / painting_s)


def plan_step(
    index: int,
    request: JobRequest,
    params: Json,
    info: Mapping[str, Json],
    results: Mapping[str, Mapping[str, TaskResult]],
) -> list[Task]:
    """The checked tasks of step `index`.

    Args:
        index: index in `steps_of`; the step after the method's last is the platform's own.
        params: the job's parameters, every default filled in.
        info: input name -> the asset's info.
        results: results of finished steps.

    Raises:
        PlanError: keys repeat, a dependency is unknown, tasks wait for each other, runs of frames overlap.
        ImpastoError: an error of the method.
    """
    chosen = method(request.method)
    parsed = parse_params(chosen, params)
    steps = chosen.steps_of(parsed)
    if index == len(steps):
        weight = expected_weights(chosen, parsed, info.get("video", {}))[-1]
        return [Task(ASSEMBLE, weight=weight, resources=resources_per_pixel(_video(info), _ASSEMBLE_BYTES))]
    video = video_info(info.get("video", {}), parsed.lead_frames)
    context = PlanContext(
        parsed, request.seed, video, frozenset(request.inputs), results, request.output.encoding.is_deep
    )
    step = steps[index]
    default = chosen.resources(step.name, context)
    tasks = [task if task.resources else replace(task, resources=default) for task in step.plan(context)]
    check_plan(tasks, step.name, results, [step.name for step in steps])
    return tasks


def _video(info: Mapping[str, Json]) -> VideoInfo:
    return video_info(info.get("video", {}))
