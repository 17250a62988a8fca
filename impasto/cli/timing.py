"""Time of a render: the method's own wall time, without decoding, encoding and start-up.

`seconds` is the sum, over every step but the platform's "assemble", of the stage "method" that workers measure around
the method's own work. Where several attempts ran at once their times overlap; the sum is then scaled by the wall time
in which at least one of them ran over the sum of their durations, so that an overlap counts once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from workers.model import Job, Json, TaskView

PLATFORM_STEP = "assemble"
METHOD_STAGE = "method"


@dataclass(frozen=True)
class Timing:
    """Seconds of a job: in all, by step, by stage."""

    seconds: float
    steps: dict[str, float]
    stages: dict[str, float]
    """Summed over all tasks of all steps, "decode" and "encode" among them; overlaps are NOT taken out."""

    @staticmethod
    def of(job: Job, tasks: Iterable[TaskView]) -> Timing:
        share = overlap(_spans(tasks))
        steps = {
            step.name: step.stages.get(METHOD_STAGE, step.seconds) * share
            for step in job.steps
            if step.name != PLATFORM_STEP
        }
        return Timing(sum(steps.values()), steps, _stages(job))


def overlap(spans: Sequence[tuple[float, float]]) -> float:
    """Wall time covered by `spans` over the sum of their lengths: 1 one after another, 1/n for n at once."""
    total = sum(stop - start for start, stop in spans)
    covered, reached = 0.0, float("-inf")
    for start, stop in sorted(spans):
        covered += max(0.0, stop - max(start, reached))
        reached = max(reached, stop)
    return covered / total if total > 0 else 1.0


def _spans(tasks: Iterable[TaskView]) -> list[tuple[float, float]]:
    """Start and end of the attempt that counted, for every finished task of the method."""
    last = [task.attempts[-1] for task in tasks if task.step != PLATFORM_STEP and task.attempts]
    return [span for span in map(_span, last) if span]


def _span(attempt: Json) -> tuple[float, float] | None:
    start, stop = attempt.get("started_at"), attempt.get("finished_at")
    return (start, stop) if start is not None and stop is not None else None


def _stages(job: Job) -> dict[str, float]:
    found: dict[str, float] = {}
    for step in job.steps:
        for stage, seconds in step.stages.items():
            found[stage] = found.get(stage, 0.0) + seconds
    return found


def rounded(values: dict[str, float]) -> Json:
    return {name: round(value, 4) for name, value in values.items()}
