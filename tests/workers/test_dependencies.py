"""Tasks that depend on tasks of any earlier step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pipeline.methods.base import Task
from pipeline.methods.plan_check import PlanError, check_plan
from tests.contracts.databases import DATABASES
from tests.workers.conftest import finished, request_on, result
from tests.workers.relay_method import Relay
from workers.farm import Farm

RESULT = b"0[01]" + b"1[01]0" + b"0[01]1" + b"1[01]0"


@pytest.fixture(params=DATABASES)
def farm(request: pytest.FixtureRequest, open_farm: Callable[..., Farm], monkeypatch: pytest.MonkeyPatch) -> Farm:
    found = {"relay": Relay()}
    monkeypatch.setattr("pipeline.methods.methods", lambda: found)
    return open_farm(database_url=DATABASES[request.param](request, True))


def _run(farm: Farm, data: Path, **params: Any) -> Any:
    request = request_on(farm, data, method="relay", params=params)
    return finished(farm, farm.jobs.submit(request).id)


def test_a_third_step_loads_artefacts_of_the_first(farm: Farm, data: Path) -> None:
    job = _run(farm, data)
    assert (job.state, job.error) == ("succeeded", None)
    assert result(farm, job.id) == RESULT
    results, _ = farm.store.task_inputs.before(job.id, 3)
    assert results["mix"]["mix-0"] == {"after": ["scan/even", "draw/run-0"]}
    assert results["mix"]["mix-3"] == {"after": ["scan/odd", "draw/run-3", "mix-2"]}


def test_undeclared_artefacts_are_not_available_to_a_task(farm: Farm, data: Path) -> None:
    job = _run(farm, data, load="odd")
    assert (job.state, job.error.code) == ("failed", "internal-error")
    assert "scan/odd" in job.error.message


def test_a_retried_job_keeps_dependencies_on_earlier_steps(farm: Farm, data: Path) -> None:
    job_id = farm.jobs.submit(request_on(farm, data, method="relay")).id
    farm.jobs.cancel(job_id)
    farm.jobs.retry(job_id)
    assert finished(farm, job_id).state == "succeeded"
    assert result(farm, job_id) == RESULT


@pytest.mark.parametrize(
    ("after", "message"),
    [
        ("colour/all", "`after` names an unknown step: 'colour/all'."),
        ("mix/mix-1", "`after` names the task's own step: 'mix/mix-1'."),
        ("scan/none", "The step 'scan' has no task 'none'."),
        ("mix-9", "The step 'mix' has no task 'mix-9'."),
        ("mix-3", "Tasks wait for each other: mix-0 -> mix-1 -> mix-2 -> mix-3 -> mix-0."),
    ],
)
def test_a_bad_dependency_fails_the_job_with_its_name(farm: Farm, data: Path, after: str, message: str) -> None:
    job = _run(farm, data, after=(after,))
    assert job.error is not None
    assert (job.state, job.error.code) == ("failed", "bad-plan")
    assert job.error.message.startswith(message), job.error.message


def test_a_later_step_cannot_be_named() -> None:
    with pytest.raises(PlanError, match="`after` names a later step: 'mix/mix-0'") as raised:
        check_plan([Task("run-0", after=("mix/mix-0",))], "draw", {"scan": {"even"}}, ["scan", "draw", "mix"])
    assert raised.value.field == "draw/run-0"
