"""The plan of a job before it runs: its tasks by kind, its critical path, and how long it takes on 1 to 64 processors.

Steps that have run are planned from what they found. A later step is planned from the results that its method expects
of the steps between (`Method.expected_results`). The processor time of the whole job is that of its estimate; a task
has a share of it by its weight.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby

from pipeline.errors import BadParameter
from pipeline.methods import method, parse_params
from pipeline.methods.base import PlanContext, Task, TaskResult
from pipeline.methods.layers import LAYERS
from workers.contract.request import JobRequest, Json
from workers.jobs.frame_window import video_info
from workers.jobs.replay import PROCESSORS, TimedTask, by_step, critical_path, replayed
from workers.scheduling.planning import plan_step, steps_of

Results = Mapping[str, Mapping[str, TaskResult]]
"""Results of tasks: step name -> task key -> result."""


@dataclass(frozen=True)
class TaskKind:
    """Tasks of a step whose keys differ in numbers only, or a stretch of them on the critical path.

    Attributes:
        step, title: name and title of the step.
        kind: the key, with N in place of numbers.
        cpu_s: processor time of these tasks, seconds.
        seconds: time that they take one after another on a machine with idle processors.
        expected: whether the step is planned from expected results, since a step before it has not run.
    """

    step: str
    title: str
    kind: str
    tasks: int
    cpu_s: float
    seconds: float
    expected: bool


@dataclass(frozen=True)
class Duration:
    """Expected time on a number of processors."""

    processors: int
    seconds: float
    speedup: float


@dataclass(frozen=True)
class Explanation:
    """A plan and how long it takes.

    Attributes:
        frames: to paint.
        cpu_s: processor time of all tasks, seconds.
        path_s: time of the critical path, which no number of processors shortens, seconds.
        kinds: all tasks, in the order of the plan.
        path: the critical path, in order.
        durations: for 1, 2, 4, 8, 16 and 64 processors.
    """

    frames: int
    cpu_s: float
    path_s: float
    kinds: tuple[TaskKind, ...]
    path: tuple[TaskKind, ...]
    durations: tuple[Duration, ...]

    def as_json(self) -> Json:
        return asdict(self)


def explained(request: JobRequest, info: Mapping[str, Json], found: Results, cpu_s: float) -> Explanation:
    """Plan all steps of a job.

    Args:
        info: input name -> facts of the asset, those of the video for the piece that is painted.
        found: results of the steps that have run, at least the first.
        cpu_s: expected processor time of the job, seconds.

    Raises:
        BadParameter: the plan is known only while the job runs.
        PlanError, ImpastoError: see `plan_step`.
    """
    if request.method == LAYERS:
        raise _unknown("The plan of several layers depends on what each of them finds", request)
    chosen = method(request.method)
    plans, certain = plans_of(request, info, found)
    total = sum(task.weight for tasks in plans.values() for task in tasks)
    timed = timed_tasks(plans, lambda name: (cpu_s / total, chosen.task_threads.get(name, 1.0)))
    names = steps_of(chosen, parse_params(chosen, request.params))
    path, alone = critical_path(timed), replayed(timed, 1)
    times = [(count, replayed(timed, count)) for count in PROCESSORS]
    frames = video_info(info["video"]).frames
    return Explanation(
        frames, round(cpu_s, 2), round(sum(task.shortest_s for task in path), 2),
        tuple(each for tasks in by_step(timed).values() for each in _kinds(tasks, names, certain)),
        tuple(each for run in _stretches(path) for each in _kinds(run, names, certain)),
        tuple(Duration(count, round(seconds, 2), round(alone / seconds, 2)) for count, seconds in times),
    )  # fmt: skip


def plans_of(
    request: JobRequest, info: Mapping[str, Json], found: Results
) -> tuple[dict[str, list[Task]], int]:  # fmt: skip
    """Step -> its tasks, the platform's last step included, and the number of steps that are planned without expected
    results. Arguments and errors as of `explained`."""
    chosen = method(request.method)
    params = parse_params(chosen, request.params)
    given, results, plans = params.model_dump(mode="json"), dict(found), dict[str, list[Task]]()
    steps = chosen.steps_of(params)
    certain = len(steps)
    for index, (step, _) in enumerate(steps_of(chosen, params)):
        plans[step] = plan_step(index, request, given, info, results)
        if index < len(steps) and (name := steps[index].name) not in results:
            context = PlanContext(
                params, request.seed, video_info(info["video"], params.lead_frames), frozenset(request.inputs), results
            )
            if (expected := chosen.expected_results(name, context)) is None:
                raise _unknown(f"The plan depends on what the step {name!r} finds", request)
            results[name] = {task.key: expected.get(task.key, {}) for task in plans[name]}
            certain = min(certain, index + 1) if expected else certain
    return plans, certain


def _unknown(why: str, request: JobRequest) -> BadParameter:
    return BadParameter(
        f"{why}.", field="method", value=request.method, remedy="Ask for an estimate, which needs no plan."
    )


Rate = Callable[[str], tuple[float, float]]
"""Step and first part of a task's key ("paint/run") -> seconds of processor time for each unit of weight, and the
processors that the task keeps busy."""


def timed_tasks(plans: Mapping[str, Sequence[Task]], rate: Rate) -> list[TimedTask]:
    """The tasks of all steps with their costs."""
    found: list[TimedTask] = []
    for number, (step, tasks) in enumerate(plans.items()):
        for task in tasks:
            seconds, threads = rate(named(step, task.key))
            after = tuple(key for key in task.after if "/" not in key)
            found.append(TimedTask(number, task.key, seconds * task.weight, after, threads))
    return found


def named(step: str, key: str) -> str:
    """The name by which a `Rate` and `Method.task_threads` know a task."""
    return f"{step}/{key.partition('-')[0]}"


def _kind(task: TimedTask) -> tuple[int, str]:
    return task.step, re.sub(r"\d+", "N", task.key)


def _stretches(path: list[TimedTask]) -> list[list[TimedTask]]:
    return [list(run) for _, run in groupby(path, _kind)]


def _kinds(tasks: list[TimedTask], names: tuple[tuple[str, str], ...], certain: int) -> list[TaskKind]:
    """The tasks by kind, in the order in which a kind first occurs."""
    found: dict[tuple[int, str], TaskKind] = {}
    for task in tasks:
        step, kind = at = _kind(task)
        before = found.get(at, TaskKind(*names[step], kind, 0, 0.0, 0.0, certain <= step < len(names) - 1))
        found[at] = replace(
            before, tasks=before.tasks + 1, cpu_s=before.cpu_s + task.seconds, seconds=before.seconds + task.shortest_s
        )
    return [replace(each, cpu_s=round(each.cpu_s, 3), seconds=round(each.seconds, 3)) for each in found.values()]
