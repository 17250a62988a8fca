"""Fault injection: an unexpected error about one job never stalls the queue, other jobs or other owners."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.waiting import until
from tests.workers.conftest import finished, request_on
from workers.contract.record import Job, RunState
from workers.farm import Farm
from workers.pools.local_pool import LocalPool
from workers.scheduling.step_planner import StepPlanner
from workers.store import plans, task_queue
from workers.store.task_queue import TaskQueue

SKIP_S = 0.5


@pytest.fixture(autouse=True)
def quick_skip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workers.scheduling.step_planner.SKIP_S", SKIP_S)


@pytest.fixture
def farm(open_farm: Callable[..., Farm]) -> Farm:
    """A farm with one worker, so that a job that blocked it would be noticed."""
    return open_farm(start=False, workers=1)


class Faults:
    """Replaces a function and raises an error if it is called for the broken job."""

    def __init__(self, applies: Callable[..., bool]) -> None:
        self.active, self.count = True, 0
        self._applies = applies

    def around(self, act: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*args: Any, **named: Any) -> Any:
            if self.active and self._applies(*args, **named):
                self.count += 1
                raise RuntimeError("injected")
            return act(*args, **named)

        return wrapped


def jobs_of(farm: Farm, data: Path) -> tuple[Job, list[Job]]:
    """The job to be broken, which is first in every order, and two jobs of its owner and of another one."""
    broken = farm.jobs.submit(request_on(farm, data, "anna", name="broken", priority=9), owner="anna")
    others = [farm.jobs.submit(request_on(farm, data, owner, name=owner), owner=owner) for owner in ("anna", "ben")]
    return broken, others


def assert_others_end(farm: Farm, others: list[Job], faults: Faults) -> None:
    for job in others:
        assert finished(farm, job.id, 15).state is RunState.SUCCEEDED
    assert faults.count > 0


def test_a_job_whose_claim_fails_is_skipped_temporarily(
    farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, others = jobs_of(farm, data)
    faults = Faults(lambda job, dispatcher: job.job_id == broken.id)
    monkeypatch.setattr(task_queue, "claim_in", faults.around(task_queue.claim_in))
    farm.start()
    assert_others_end(farm, others, faults)
    assert farm.jobs.get(broken.id).state is RunState.QUEUED
    faults.active = False
    assert finished(farm, broken.id).state is RunState.SUCCEEDED


def test_an_unreadable_request_fails_only_its_job(farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken, others = jobs_of(farm, data)
    faults = Faults(lambda value: value["name"] == "broken")
    monkeypatch.setattr(plans, "request_of", faults.around(plans.request_of))
    farm.start()
    assert_others_end(farm, others, faults)
    error = finished(farm, broken.id).error
    assert error is not None and error.code == "internal-error"


def test_a_job_whose_failed_plan_cannot_be_recorded_is_skipped_temporarily(
    farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, others = jobs_of(farm, data)
    faults = Faults(lambda planner, todo: todo.job_id == broken.id)
    unrecorded = Faults(lambda store, job_id, *_: job_id == broken.id)
    monkeypatch.setattr(StepPlanner, "_plan_and_store", faults.around(StepPlanner._plan_and_store))
    monkeypatch.setattr(plans.Plans, "plan_failed", unrecorded.around(plans.Plans.plan_failed))
    farm.start()
    assert_others_end(farm, others, faults)
    assert unrecorded.count > 0
    assert farm.jobs.get(broken.id).state is RunState.QUEUED
    faults.active = unrecorded.active = False
    assert finished(farm, broken.id).state is RunState.SUCCEEDED


def test_a_permanently_unstorable_outcome_occupies_no_slot(
    farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, others = jobs_of(farm, data)

    def is_broken(queue: TaskQueue, first: Any, *_: Any, **__: Any) -> bool:
        attempt_id = first if isinstance(first, str) else first.attempt_id
        running = farm.tasks.page(broken.id, "running").items
        return any(attempt["id"] == attempt_id for task in running for attempt in task.attempts)

    faults = Faults(is_broken)
    for name in ("finish", "postpone"):
        monkeypatch.setattr(TaskQueue, name, faults.around(getattr(TaskQueue, name)))
    farm.start()
    assert_others_end(farm, others, faults)
    assert farm.jobs.get(broken.id).state is RunState.RUNNING
    faults.active = False
    assert finished(farm, broken.id).state is RunState.SUCCEEDED


def test_an_order_refused_by_the_pool_fails_only_its_job(
    farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken, others = jobs_of(farm, data)
    faults = Faults(lambda pool, order: order.job_id == broken.id)
    monkeypatch.setattr(LocalPool, "submit", faults.around(LocalPool.submit))
    farm.start()
    assert_others_end(farm, others, faults)
    assert finished(farm, broken.id).state is RunState.FAILED


def test_a_failing_release_of_an_attempt_delays_no_other_job(
    farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two attempts of a dead dispatcher; the release of one of them fails."""
    broken, others = jobs_of(farm, data)
    store = farm.store
    for todo in store.plans.to_plan(10):
        farm._dispatcher._planner.plan_one(todo)  # type: ignore[union-attr]
    claims = [store.queue.claim("dsp_dead@here", -1.0) for _ in range(3)]
    stuck = next(claim for claim in claims if claim is not None and claim.job_id == broken.id)
    faults = Faults(lambda queue, outcome, *_, **__: outcome.attempt_id == stuck.attempt_id)
    monkeypatch.setattr(TaskQueue, "finish", faults.around(TaskQueue.finish))
    farm.start()
    assert_others_end(farm, others, faults)


@pytest.mark.parametrize("part", ["progress", "attempts_of", "renew"])
def test_a_failing_dispatch_phase_does_not_stop_the_others(
    part: str, farm: Farm, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults = Faults(lambda *_: True)
    monkeypatch.setattr(TaskQueue, part, faults.around(getattr(TaskQueue, part)))
    jobs = [farm.jobs.submit(request_on(farm, data, params={"tasks": 1, "sleep_s": 0.6}, seed=i)) for i in range(2)]
    farm.start()
    assert_others_end(farm, jobs, faults)
    assert until(lambda: farm.jobs.get(jobs[0].id).progress == 1.0)
