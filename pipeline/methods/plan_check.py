"""Checks of the tasks that a step has planned, for the farm and for the local runner."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter

from pipeline.errors import ImpastoError, did_you_mean
from pipeline.methods.base import Resources, Task

_KEY = re.compile(r"[a-z0-9-]{1,200}")
_LISTED = 20
"""Keys that an error message lists."""


class PlanError(ImpastoError):
    """A method planned something that cannot be run: the method's fault, not the user's."""

    code = "bad-plan"


def dependencies(after: Sequence[str], own_step: str) -> dict[str, set[str]]:
    """Keys that `Task.after` names, by step: "scan/all" names the task "all" of "scan", "all" one of `own_step`."""
    named: dict[str, set[str]] = {}
    for name in after:
        step, slash, key = name.partition("/")
        named.setdefault(step if slash else own_step, set()).add(key if slash else name)
    return named


def check_plan(tasks: Sequence[Task], step: str, earlier: Mapping[str, Collection[str]], steps: Sequence[str]) -> None:
    """Raise PlanError unless the tasks can be run as they are.

    Args:
        step: the name of their step.
        earlier: keys of the tasks of every finished step, by step.
        steps: names of all steps of the method, in order.
    """
    keys = {task.key for task in tasks}
    if len(keys) != len(tasks):
        raise PlanError("Two tasks of a step have the same key.", field=step)
    known = {**earlier, step: keys}
    for task in tasks:
        _check_task(task, step)
        for name in task.after:
            _check_dependency(name, task, step, known, steps)
    _check_cycles(tasks, step)
    _check_runs([task.emits for task in tasks if task.emits is not None], step)


def _check_task(task: Task, step: str) -> None:
    if not _KEY.fullmatch(task.key):
        raise PlanError("A task's key is made of [a-z0-9-].", field=step, value=task.key)
    if not (math.isfinite(task.weight) and task.weight > 0):
        raise PlanError("A task's weight is a positive number.", field=f"{step}/{task.key}", value=task.weight)
    if task.resources is not None and not _possible(task.resources):
        raise PlanError("No machine has what a task needs.", field=f"{step}/{task.key}", value=task.resources)
    try:
        json.dumps(task.args, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise PlanError(f"A task's args are not JSON: {error}.", field=f"{step}/{task.key}") from None


def _check_dependency(
    name: str, task: Task, own_step: str, keys: Mapping[str, Collection[str]], steps: Sequence[str]
) -> None:
    """`keys`: of the tasks of the finished steps and of the task's own step."""
    field = f"{own_step}/{task.key}"
    step, slash, key = name.partition("/")
    if not slash:
        step, key = own_step, name
    elif step == own_step:
        remedy = f"Write {key!r} for a task of the same step."
        raise PlanError(f"`after` names the task's own step: {name!r}.", field=field, value=name, remedy=remedy)
    if step not in steps:
        remedy = did_you_mean(step, steps, "steps")
        raise PlanError(f"`after` names an unknown step: {name!r}.", field=field, value=name, remedy=remedy)
    if step not in keys:
        remedy = f"A task of {own_step!r} may wait for tasks of {own_step!r} and of the steps before it."
        raise PlanError(f"`after` names a later step: {name!r}.", field=field, value=name, remedy=remedy)
    if key not in keys[step]:
        remedy = did_you_mean(key, sorted(keys[step])[:_LISTED], f"tasks ({len(keys[step])} in all)")
        raise PlanError(f"The step {step!r} has no task {key!r}.", field=field, value=name, remedy=remedy)


def _possible(resources: Resources) -> bool:
    """Some processor, and whole GPUs or a part of one."""
    cpus = 1.0 if resources.cpus is None else resources.cpus
    gpus = 0.0 if resources.gpus is None else resources.gpus
    whole = gpus <= 1 or float(gpus).is_integer()
    return 0 < cpus < math.inf and 0 <= gpus < math.inf and whole and resources.memory_bytes >= 0


def _check_cycles(tasks: Sequence[Task], step: str) -> None:
    try:
        TopologicalSorter({task.key: dependencies(task.after, step).get(step, set()) for task in tasks}).prepare()
    except CycleError as error:
        cycle = " -> ".join(error.args[1])
        raise PlanError(f"Tasks wait for each other: {cycle}.", field=step, value=error.args[1]) from None


def _check_runs(runs: Sequence[tuple[int, int]], step: str) -> None:
    end = 0
    for start, stop in sorted(runs):
        if start < end or stop <= start:
            raise PlanError("Runs of frames overlap or are empty.", field=step, value=(start, stop))
        end = stop
