"""Progress and remaining time of a job: pure arithmetic on weights, counts and measured seconds.

Weights of all steps of a method have one unit (`pipeline.methods.base.Task`), so that steps can be added. A step
without tasks counts with the weight that was expected when the job was accepted. If the plan differs, only the
unfinished part of the bar is divided again, so that progress decreases only if work was lost.

The remaining time is measured: worker seconds per unit of weight, times the remaining weight, divided by the number of
running attempts. Pauses and restarts do not distort it. In a step whose tasks finish one after another, the seconds of
the last minutes count, because the load of the machine changes in the course of a long job.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import exp

ENOUGH = 0.01
"""Share of a job's weight that must be finished before its speed is used."""
RECENT_S = 120.0
"""Worker seconds over which the recent pace is averaged: older tasks count by exp(-seconds since / RECENT_S)."""
SETTLED, SETTLED_S = 0.2, 60.0
"""Finished share of a step, or worker seconds in it, after which its own speed is used. Before, start-up distorts
it."""


@dataclass(frozen=True)
class StepMeter:
    """Measures of one step at the time of its tasks' last progress report."""

    expected: float
    """Expected weight of the step before it was planned."""
    weight: float
    """Total weight of its tasks; 0 until it is planned."""
    weight_done: float
    """Weight of its finished tasks."""
    busy_s: float
    """Wall seconds of finished attempts, summed."""
    planned: bool
    done: bool
    running: int = 0
    """Number of running attempts. One that has just ended counts while a task is ready to replace it."""
    running_weight_done: float = 0.0
    """Sum over running tasks of weight times progress."""
    running_s: float = 0.0
    """Wall seconds of running attempts up to that moment, summed."""
    pace_s: float | None = None
    """Worker seconds per unit of weight of the tasks that have finished lately; see `recent_pace_s`."""

    @property
    def whole(self) -> float:
        """Weight of the step as far as it is known."""
        return self.weight if self.planned else self.expected

    @property
    def finished(self) -> float:
        """Weight that is done."""
        return self.whole if self.done else min(self.whole, self.weight_done + self.running_weight_done)

    @property
    def progress(self) -> float:
        """0..1"""
        return 1.0 if self.done else self.finished / self.whole if self.whole > 0 else 0.0

    @property
    def seconds(self) -> float:
        """Worker seconds of the finished weight."""
        return self.busy_s + self.running_s


def recent_pace_s(before: float | None, seconds: float, weight: float) -> float | None:
    """Recent worker seconds per unit of weight, after a task of this weight took `seconds`; `before`: until then."""
    if weight <= 0:
        return before
    latest = seconds / weight
    return latest if before is None else before + (latest - before) * (1 - exp(-seconds / RECENT_S))


def job_progress(steps: Sequence[StepMeter]) -> float:
    """0..1 over all steps."""
    return sum(share * step.progress for share, step in zip(_shares(steps), steps, strict=True))


def job_eta_s(steps: Sequence[StepMeter]) -> float | None:
    """Seconds left; None while too little is done for an estimate."""
    whole, finished = sum(step.whole for step in steps), sum(step.finished for step in steps)
    current = next((step for step in steps if not step.done), None)
    if current is None:
        return 0.0
    pace = _pace(steps, current)
    if pace is None or finished < ENOUGH * whole:
        return None
    return max(0.0, whole - finished) * pace / max(1, current.running)


def _pace(steps: Sequence[StepMeter], current: StepMeter) -> float | None:
    """Worker seconds per unit of weight in the current step; at its beginning, in earlier steps."""
    past = [step for step in steps if step.done]
    own, before = current.pace_s or _ratio([current]), _ratio(past)
    if own is None or before is None:
        return before if own is None else own
    trust = min(1.0, max(current.progress / SETTLED, current.seconds / SETTLED_S))
    return trust * own + (1 - trust) * before


def _ratio(steps: Sequence[StepMeter]) -> float | None:
    weight = sum(step.finished for step in steps)
    return sum(step.seconds for step in steps) / weight if weight > 0 else None


def _shares(steps: Sequence[StepMeter]) -> Iterator[float]:
    """Share of each step in the progress bar; the shares sum to 1.

    Each step takes a part of the bar that earlier steps have left, in proportion to its weight and the expected weights
    of later steps.
    """
    left, later = 1.0, sum(step.expected for step in steps)
    for index, step in enumerate(steps):
        later -= step.expected
        last = index == len(steps) - 1
        share = left if last or step.whole + later <= 0 else left * step.whole / (step.whole + later)
        left -= share
        yield share
