"""Runs a method's plan in this process, measures the CPU time of tasks and stages, and simulates several workers."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from pipeline.frames import Frame
from pipeline.methods.base import AnyParams, Method, P, Task
from pipeline.methods.local import LocalContext, iterate_plan
from workers.jobs.replay import TimedTask, replayed

TimedTasks = dict[str, list[tuple[Task, float]]]
"""Step name -> the tasks of the step in the order in which they ran, each with its CPU seconds."""


class TimedContext(LocalContext[P]):
    """An in-memory context that counts CPU seconds of this thread by stage.

    Attributes:
        stages: CPU seconds by stage.
    """

    def __init__(self, params: P, video: Sequence[Frame]) -> None:
        super().__init__(params, video)
        self.stages: dict[str, float] = defaultdict(float)

    @contextmanager
    def clock(self, stage: str) -> Iterator[None]:
        start = time.thread_time()
        yield
        self.stages[stage] += time.thread_time() - start


def run_timed(method: Method, context: LocalContext[AnyParams]) -> TimedTasks:
    """Run the whole plan. Planning a step counts towards the step's first task."""
    spent: TimedTasks = {step.name: [] for step in method.steps_of(context.params)}
    start = time.thread_time()
    for step, task in iterate_plan(method, context):
        spent[step].append((task, time.thread_time() - start))
        start = time.thread_time()
    return spent


def makespan(tasks: Sequence[tuple[Task, float]], workers: int) -> float:
    """Seconds that a step takes, see `workers.jobs.replay`."""
    timed = [TimedTask(0, task.key, seconds, task.after) for task, seconds in tasks]
    return replayed(timed, workers, dispatch_s=0.0)
