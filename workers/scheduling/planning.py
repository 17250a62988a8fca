"""From a job to the tasks of its next step: the method plans, this checks. Knows no store and no pool."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter

from pipeline.errors import ImpastoError
from pipeline.methods import method, parse_params
from pipeline.methods.base import Method, PlanContext, Resources, Task, TaskResult, VideoInfo, resources_per_pixel
from workers.model import JobRequest, Json
from workers.state_machine import ASSEMBLE

_KEY = re.compile(r"[a-z0-9-]{1,200}")
_ASSEMBLE_TITLE = "Join frames and sound"
_ASSEMBLE_WEIGHT = 0.05
"""A frame: see `pipeline.methods.base.Task.weight`."""
_ASSEMBLE_BYTES = 100.0
"""A pixel: a few decoded frames for the poster and the contact sheet."""


class PlanError(ImpastoError):
    """A method planned something that cannot be run: the method's fault, not the user's."""

    code = "bad-plan"


def steps_of(chosen: Method) -> tuple[tuple[str, str], ...]:
    """(name, title) of a job's steps: the method's, then the platform's own."""
    return (*((step.name, step.title) for step in chosen.steps), (ASSEMBLE, _ASSEMBLE_TITLE))


def expected_weights(chosen: Method, info: Json) -> tuple[float, ...]:
    """What each of `steps_of` will weigh, as far as that is known of a video before anything is planned."""
    frames = max(1, video_info(info).frames)
    return (*(frames * step.weight for step in chosen.steps), frames * _ASSEMBLE_WEIGHT)


def plan_step(
    index: int,
    request: JobRequest,
    params: Json,
    info: Mapping[str, Json],
    results: Mapping[str, Mapping[str, TaskResult]],
) -> list[Task]:
    """The checked tasks of step `index`.

    Args:
        index: of `steps_of`; the one after the method's last is the platform's own.
        params: the job's parameters, every default filled in.
        info: input name -> the asset's info.
        results: of finished steps.

    Raises:
        PlanError: keys repeat, chains go round, runs of frames overlap.
        ImpastoError: what the method itself finds wrong.
    """
    chosen = method(request.method)
    if index == len(chosen.steps):
        weight = expected_weights(chosen, info.get("video", {}))[-1]
        return [Task(ASSEMBLE, weight=weight, resources=resources_per_pixel(_video(info), _ASSEMBLE_BYTES))]
    context = PlanContext(parse_params(chosen, params), request.seed, _video(info), frozenset(request.inputs), results)
    step = chosen.steps[index]
    default = chosen.resources(step.name, context)
    tasks = [task if task.resources else replace(task, resources=default) for task in step.plan(context)]
    _check(tasks, step.name)
    return tasks


def video_info(info: Json) -> VideoInfo:
    """What planning may know of a video, from its asset's info."""
    return VideoInfo(
        int(info.get("width", 0)),
        int(info.get("height", 0)),
        int(info.get("frames", 0)),
        float(info.get("fps", 0.0)),
        float(info.get("duration_s", 0.0)),
    )


def _video(info: Mapping[str, Json]) -> VideoInfo:
    return video_info(info.get("video", {}))


def _check(tasks: Sequence[Task], step: str) -> None:
    keys = {task.key for task in tasks}
    if len(keys) != len(tasks):
        raise PlanError("Two tasks of a step have the same key.", field=step)
    for task in tasks:
        _check_task(task, keys, step)
    _check_chains(tasks, step)
    _check_runs([task.emits for task in tasks if task.emits is not None], step)


def _check_task(task: Task, keys: set[str], step: str) -> None:
    if not _KEY.fullmatch(task.key):
        raise PlanError("A task's key is made of [a-z0-9-].", field=step, value=task.key)
    if not (math.isfinite(task.weight) and task.weight > 0):
        raise PlanError("A task's weight is a positive number.", field=f"{step}/{task.key}", value=task.weight)
    if task.resources is not None and not _possible(task.resources):
        raise PlanError("No machine has what a task needs.", field=f"{step}/{task.key}", value=task.resources)
    if unknown := set(task.after) - keys:
        raise PlanError("A task waits for one that is not in its step.", field=f"{step}/{task.key}", value=unknown)
    try:
        json.dumps(task.args, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise PlanError(f"A task's args are not JSON: {error}.", field=f"{step}/{task.key}") from None


def _possible(resources: Resources) -> bool:
    """Some processor, and whole GPUs or a part of one."""
    cpus = 1.0 if resources.cpus is None else resources.cpus
    gpus = 0.0 if resources.gpus is None else resources.gpus
    whole = gpus <= 1 or float(gpus).is_integer()
    return 0 < cpus < math.inf and 0 <= gpus < math.inf and whole and resources.memory_bytes >= 0


def _check_chains(tasks: Sequence[Task], step: str) -> None:
    try:
        TopologicalSorter({task.key: task.after for task in tasks}).prepare()
    except CycleError as error:
        raise PlanError("Tasks wait for each other.", field=step, value=error.args[1]) from None


def _check_runs(runs: Sequence[tuple[int, int]], step: str) -> None:
    end = 0
    for start, stop in sorted(runs):
        if start < end or stop <= start:
            raise PlanError("Runs of frames overlap or are empty.", field=step, value=(start, stop))
        end = stop
