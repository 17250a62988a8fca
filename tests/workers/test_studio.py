"""The farm from outside: what is submitted comes out, whatever happens on the way."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.workers.conftest import finished, request_on, result, until
from workers.errors import Conflict, IdempotencyMismatch, NotFound
from workers.studio import Studio


def test_a_job_runs_all_its_steps_and_its_result_can_be_read(farm: Studio, data: Path) -> None:
    job = finished(farm, farm.submit(request_on(farm, data, params={"tasks": 5})).id)
    assert (job.state, job.progress, job.error) == ("succeeded", 1.0, None)
    assert [(step.name, step.state, step.counts["succeeded"]) for step in job.steps] == [
        ("look", "succeeded", 1),
        ("draw", "succeeded", 5),
        ("assemble", "succeeded", 1),
    ]
    assert job.results == ("result",)
    assert len(result(farm, job.id)) == 5 * 8
