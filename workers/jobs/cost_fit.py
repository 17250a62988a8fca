"""A model of a job's time by number and size of frames, fitted to a few measured jobs.

    seconds  =  c (s + frames) (pixels / 10^6)^g

The model has three unknowns, and often there are only one or two jobs, whose times also depend on the content of the
video and on the load of the machine. Therefore the exponent g and the start-up term s have prior expected values. The
more the jobs vary in frame size and length, the more they change these values: it is the maximum a posteriori estimate
with normally distributed logarithms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import exp, log
from typing import NamedTuple

NOISE = 0.3
"""Standard deviation of the logarithm of a job's time from the model, due to the video's content and the machine's
load."""
GROWTH_SPREAD = 0.3
"""Standard deviation of the exponent g from the method's own value."""
GROWTHS = tuple(step / 20 for step in range(31))
STARTS, START_SPREAD = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0), 1.0
"""Start-up terms that are tried, as numbers of frames, and the standard deviation of the logarithm of 1 + s."""


class TaskAmount(NamedTuple):
    """Amount of work of a job."""

    frames: int
    pixels: int
    """Pixels of a frame."""


@dataclass(frozen=True)
class CostModel:
    """Attributes: see the equation above; `start` is in frames."""

    level: float
    start: float
    growth: float

    def of(self, work: TaskAmount) -> float:
        """Time that the work takes, seconds."""
        return exp(self.level + _shape(work, self.start, self.growth))


def fitted(measured: Sequence[tuple[TaskAmount, float]], expected_growth: float) -> CostModel:
    """The most probable model.

    Args:
        measured: at least one job and its seconds, > 0.
        expected_growth: the method's own exponent (`Method.cpu_growth`).
    """

    def improbability(model: CostModel) -> float:
        away = (model.growth - expected_growth) / GROWTH_SPREAD, log(1 + model.start) / START_SPREAD
        return _misfit(measured, model) + away[0] ** 2 + away[1] ** 2

    models = [_with(measured, start, growth) for start, growth in product(STARTS, GROWTHS)]
    return min(models, key=improbability)


def _misfit(measured: Sequence[tuple[TaskAmount, float]], model: CostModel) -> float:
    return sum(((log(max(seconds, 1e-6)) - log(model.of(work))) / NOISE) ** 2 for work, seconds in measured)


def _with(measured: Sequence[tuple[TaskAmount, float]], start: float, growth: float) -> CostModel:
    """The model with this start-up term and exponent, and the factor c that fits best."""
    differences = [log(max(seconds, 1e-6)) - _shape(work, start, growth) for work, seconds in measured]
    return CostModel(sum(differences) / len(differences), start, growth)


def _shape(work: TaskAmount, start: float, growth: float) -> float:
    """Logarithm of the time without the factor c."""
    return log(start + work.frames) + growth * log(work.pixels / 1e6)
