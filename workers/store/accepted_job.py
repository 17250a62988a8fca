"""A checked request as the store accepts it, and the rows of its steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from workers.contract.record import JobWarning
from workers.contract.request import JobRequest, Json
from workers.store.records import Values


@dataclass(frozen=True)
class Accepted:
    """A checked request, completed with data for the store."""

    request: JobRequest
    params: Json
    """The parameters with every default filled in, so that a job means the same after an upgrade."""
    steps: tuple[tuple[str, str], ...]
    """(name, title) of the method's steps and the platform's own."""
    weights: tuple[float, ...] = ()
    """Expected weight of each step; empty: all equal."""
    versions: Sequence[tuple[str, int]] = ()
    """(Name, version) of each step: see `workers.jobs.plan_versions`."""
    warnings: tuple[JobWarning, ...] = ()
    """What the request gives without effect."""


def step_rows(job_id: str, accepted: Accepted) -> list[Values]:
    weights = accepted.weights or (1.0,) * len(accepted.steps)
    return [
        {"job_id": job_id, "step": i, "name": name, "title": title, "expected": weight}
        for i, ((name, title), weight) in enumerate(zip(accepted.steps, weights, strict=True))
    ]
