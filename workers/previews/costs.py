"""What the tasks of a film cost at the size of a preview, and from that what the whole film would cost at that size."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from graphlib import TopologicalSorter
from threading import Lock
from typing import Any

import psutil

from pipeline.methods.base import Task
from workers.jobs.estimates import MeasuredPreview
from workers.previews.model import LayerSources, Record

COST = "cost"
"""Type of a record for the service, which clients do not get."""
_MOST_FILMS, _MOST_OF_A_FILM = 1000, 4
"""Numbers of films, and of sets of parameters of a film, of which costs are kept."""


@dataclass
class StepCost:
    """Cost of those tasks of a step that have run: their weight, wall seconds, CPU seconds of the process, and seconds
    that the processors of the machine were idle meanwhile, summed over them."""

    weight: float = 0.0
    seconds: float = 0.0
    cpu_s: float = 0.0
    idle_s: float = 0.0

    def add(self, other: StepCost, factor: float = 1.0) -> None:
        for one in fields(self):
            setattr(self, one.name, getattr(self, one.name) + factor * getattr(other, one.name))

    def of(self, weight: float) -> StepCost:
        """The cost of tasks of this weight at the rate of those that have run."""
        found = StepCost()
        found.add(self, weight / self.weight)
        return found


class TaskClock:
    """Measures tasks, some of which run within others."""

    def __init__(self) -> None:
        self._within: list[StepCost] = []
        """For each task that runs: the time of the tasks that have run within it."""

    @contextmanager
    def measured(self, into: StepCost, weight: float) -> Iterator[None]:
        """Add the time of a task to the cost of its step, without that of tasks within it; nothing if it fails."""
        self._within.append(StepCost())
        before = _now()
        finished = False
        try:
            yield
            finished = True
        finally:
            took = _now()
            took.add(before, -1.0)
            within = self._within.pop()
            if self._within:
                self._within[-1].add(took)
            if finished:
                into.add(took)
                into.add(within, -1.0)
                into.weight += weight


def _now() -> StepCost:
    return StepCost(0.0, time.perf_counter(), time.process_time(), psutil.cpu_times().idle)


def whole_cost(steps: Mapping[str, StepCost], weights: Mapping[str, float]) -> StepCost | None:
    """The cost of all tasks of a film: each step at the rate of its tasks that have run; a step without any, at the
    rate of all together. None: hardly anything has run.

    Args:
        weights: of all tasks of each step.
    """
    overall = StepCost()
    for step in steps.values():
        overall.add(step)
    if overall.weight <= 0:
        return None
    found = StepCost()
    for name, weight in weights.items():
        step = steps.get(name, overall)
        found.add((step if step.weight > 0 else overall).of(weight))
    return found


def longest_chain(tasks: Mapping[str, Task]) -> float:
    """The largest sum of the weights of tasks of a step that wait for each other: no number of workers is faster."""
    ends: dict[str, float] = {}
    for key in TopologicalSorter({key: set(task.after) & tasks.keys() for key, task in tasks.items()}).static_order():
        ends[key] = tasks[key].weight + max((ends[name] for name in tasks[key].after if name in ends), default=0.0)
    return max(ends.values(), default=0.0)


def cost_record(layer: LayerSources, cost: MeasuredPreview) -> Record:
    """The record of a layer's cost."""
    return Record({"type": COST, "method": layer.method, "video": layer.video, **vars(cost)})


class PreviewCosts:
    """The costs that previews have measured, by method and video, the newest first. Thread-safe."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._films: OrderedDict[tuple[str, str], list[MeasuredPreview]] = OrderedDict()

    def keep(self, header: Mapping[str, Any]) -> None:
        """Keep the cost of a record's header."""
        cost = MeasuredPreview(**{field.name: header[field.name] for field in fields(MeasuredPreview)})
        with self._lock:
            film = header["method"], header["video"]
            others = [one for one in self._films.pop(film, []) if one.params != cost.params]
            self._films[film] = [cost, *others][:_MOST_OF_A_FILM]
            while len(self._films) > _MOST_FILMS:
                self._films.popitem(last=False)

    def of(self, method: str, video: str) -> list[MeasuredPreview]:
        """Costs of the whole film at the size of previews. `video`: its `video_key`."""
        with self._lock:
            return list(self._films.get((method, video), ()))
