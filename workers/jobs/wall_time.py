"""Wall seconds of a job whose tasks run at once, from those of its tasks one after another.

A preview runs the tasks of a film one after another, on a machine that also does other work; a job runs several at
once. Processors that were idle beside the preview do further tasks in full. All others are shared with the other work,
in proportion to the threads that wait for them: of n processors, t threads of ours get n t / (t + others). With one
task at a time, that was measured; so `others` is known, and from it the share of more threads.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple


class OneByOne(NamedTuple):
    """How tasks ran one after another.

    Attributes:
        width: their seconds altogether, by the seconds of the longest chain of tasks that wait for each other.
        idle: number of processors that were idle meanwhile, on average.
    """

    width: float
    idle: float


def processors_used(alone: float, measured: OneByOne, slots: int, task_cpus: float) -> float:
    """CPU seconds that a job gets a wall second.

    Args:
        alone: CPU seconds a wall second of its tasks one after another, > 0.
        slots: number of processors for tasks.
        task_cpus: processors that a task of the method keeps busy.
    """
    at_once = max(1.0, min(measured.width, ceil(slots / task_cpus)))
    further = (at_once - 1) * alone
    free = min(further, measured.idle)
    shared = further - free
    return (alone + free + shared) / (1 + shared / slots)
