"""How far a job is and how long it will take: pure arithmetic on weights, counts and measured seconds.

A step's progress is the weight that is done over the weight there is. Steps whose tasks are not known yet count as
much as the others, except the platform's last step, which only joins files. Time left is measured, not guessed:
seconds that finished and running attempts took per unit of weight, over what runs at once. So neither a pause nor a
restart spoils it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

LAST_STEP_SHARE = 0.05


@dataclass(frozen=True)
class StepMeter:
    """Measures of one step. Weights are the plan's; `busy_s` sums the wall seconds of finished attempts."""

    weight: float
    weight_done: float
    busy_s: float
    planned: bool
    done: bool
    running: int = 0
    running_weight_done: float = 0.0
    """Sum over running tasks of weight times progress."""
    running_s: float = 0.0
    """Wall seconds of running attempts so far."""

    @property
    def progress(self) -> float:
        """0..1"""
        if self.done:
            return 1.0
        if not self.planned or self.weight <= 0:
            return 0.0
        return min(1.0, (self.weight_done + self.running_weight_done) / self.weight)

    @property
    def seconds_left(self) -> float | None:
        """Wall seconds until this step is done at the present pace; None while there is no measure."""
        if self.done:
            return 0.0
        finished = self.weight_done + self.running_weight_done
        if not self.running or finished <= 0:
            return None
        pace = (self.busy_s + self.running_s) / finished
        return max(0.0, self.weight - finished) * pace / self.running


def job_progress(steps: Sequence[StepMeter]) -> float:
    """0..1 over all steps."""
    return sum(share * step.progress for share, step in zip(_shares(len(steps)), steps, strict=True))


def job_eta_s(steps: Sequence[StepMeter]) -> float | None:
    """Seconds left: the current step's, and for later steps as much per share as this one takes."""
    shares = _shares(len(steps))
    current = next((i for i, step in enumerate(steps) if not step.done), None)
    if current is None:
        return 0.0
    left = steps[current].seconds_left
    if left is None:
        return None
    undone = max(1e-6, 1.0 - steps[current].progress)
    later = sum(shares[current + 1 :]) / shares[current] * left / undone
    return left + later


def _shares(n: int) -> list[float]:
    """How much each step counts; they sum to 1."""
    if n <= 1:
        return [1.0] * n
    return [(1.0 - LAST_STEP_SHARE) / (n - 1)] * (n - 1) + [LAST_STEP_SHARE]
