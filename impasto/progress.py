"""How much of a render in this process is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pipeline.methods.base import Task
from workers.store.progress import StepMeter, job_progress


class Progress:
    """Tells the share of a plan that is done, 0 to 1, weighted as in a service. An exception of `tell` passes through.

    Args:
        expected: expected weight of each step, in order, by name.
    """

    def __init__(self, expected: Mapping[str, float], tell: Callable[[float], object]) -> None:
        self._steps = {name: StepMeter(weight, 0, 0, 0, False, False) for name, weight in expected.items()}
        self._left: dict[str, int] = {}
        self._tell = tell

    def planned(self, step: str, tasks: Sequence[Task]) -> None:
        weight = sum(task.weight for task in tasks)
        self._left[step] = len(tasks)
        self._steps[step] = replace(self._steps[step], weight=weight, planned=True, done=not tasks)

    def running(self, step: str, task: Task, done: float) -> None:
        """A task is done by this share, 0 to 1."""
        self._set(step, running_weight_done=task.weight * done)

    def finished(self, step: str, task: Task) -> None:
        self._left[step] -= 1
        weight = self._steps[step].weight_done + task.weight
        self._set(step, weight_done=weight, running_weight_done=0.0, done=self._left[step] == 0)

    def _set(self, step: str, **values: Any) -> None:
        self._steps[step] = replace(self._steps[step], **values)
        self._tell(job_progress(list(self._steps.values())))
