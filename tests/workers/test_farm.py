"""The farm from outside: submitted jobs give their results under any circumstances."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from workers.errors import Conflict, IdempotencyMismatch, NotFound
from workers.farm import Farm


def test_a_job_runs_all_its_steps_and_its_result_can_be_read(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"tasks": 5})).id)
    assert (job.state, job.progress, job.error) == ("succeeded", 1.0, None)
    assert [(step.name, step.state, step.counts["succeeded"]) for step in job.steps] == [
        ("analyze", "succeeded", 1),
        ("draw", "succeeded", 5),
        ("assemble", "succeeded", 1),
    ]
    assert job.results == ("result",)
    assert len(result(farm, job.id)) == 5 * 8


def test_the_same_request_gives_the_same_bytes_with_one_worker_and_with_two(
    open_farm: Callable[..., Farm], data: Path, tmp_path: Path
) -> None:
    results = set()
    for workers in (1, 2):
        farm = open_farm(home=tmp_path / f"home-{workers}", workers=workers)
        job = farm.jobs.submit(request_on(farm, data, params={"tasks": 8, "chain": True}))
        finished(farm, job.id)
        results.add(result(farm, job.id))
    assert len(results) == 1


def test_a_chain_runs_in_order_whatever_the_number_of_workers(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"tasks": 6, "chain": True})).id)
    tasks = [task for task in farm.tasks.page(job.id).items if task.step == "draw"]
    ends = [(task.attempts[0]["started_at"], task.attempts[0]["finished_at"]) for task in tasks]
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(ends))


def test_a_step_without_tasks_is_skipped(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"tasks": 0})).id)
    assert job.state == "succeeded"
    assert result(farm, job.id) == b""


def test_a_task_that_fails_once_is_retried(farm: Farm, data: Path, tmp_path: Path) -> None:
    params = {"trouble": "once", "mark": str(tmp_path / "mark")}
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params=params)).id)
    assert job.state == "succeeded"
    task = next(task for task in farm.tasks.page(job.id).items if task.key == "run-1")
    assert [attempt["outcome"] for attempt in task.attempts] == ["failed", "succeeded"]
    assert task.attempts[0]["error"]["message"] == "RuntimeError: the cat sat on the keyboard"


def test_a_permanently_failing_task_keeps_its_log_and_the_other_results(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"trouble": "raise", "tasks": 4})).id)
    assert job.state == "failed"
    assert job.error is not None
    assert job.error.code == "internal-error"
    task = farm.tasks.page(job.id, state="failed").items[0]
    assert [attempt["number"] for attempt in task.attempts] == [1, 2, 3]
    assert "the cat sat on the keyboard" in farm.tasks.log(task.id)
    assert job.counts["succeeded"] >= 2, "look, and run-0 that was done before"


def test_bad_input_is_not_retried(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"trouble": "bad-input"})).id)
    assert job.error is not None
    assert (job.error.code, job.error.field, job.error.remedy) == ("bad-input", "inputs.data", "Add a cat.")
    assert len(farm.tasks.page(job.id, state="failed").items[0].attempts) == 1


@pytest.mark.parametrize("trouble", ["away", "full", "descriptors"])
def test_a_shortage_of_storage_or_descriptors_costs_no_attempt(
    open_farm: Callable[..., Farm], data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: str
) -> None:
    monkeypatch.setattr("workers.scheduling.outcome_writer._RESOURCE_AWAY_S", 0.05)
    farm = open_farm(attempts=1)
    params = {"trouble": trouble, "mark": str(tmp_path / "mark")}
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params=params)).id)
    assert job.state == "succeeded"
    task = next(task for task in farm.tasks.page(job.id).items if task.key == "run-1")
    assert [attempt["outcome"] for attempt in task.attempts] == ["released", "succeeded"]


def test_a_cyclic_plan_fails_the_job(farm: Farm, data: Path) -> None:
    params = {"trouble": "cycle", "chain": True}
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params=params)).id)
    assert job.error is not None
    assert job.error.code == "bad-plan"


def test_cancel_ends_a_running_task(open_farm: Callable[..., Farm], data: Path) -> None:
    farm = open_farm(workers=1)
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 2, "sleep_s": 30}))
    until(lambda: farm.tasks.page(job.id, state="running").items and farm.jobs.get(job.id).steps[1].counts["running"])
    began = time.monotonic()
    assert farm.jobs.cancel(job.id).state == "cancelled"
    other = farm.jobs.submit(request_on(farm, data, params={"tasks": 1}, seed=8))
    assert finished(farm, other.id).state == "succeeded", "the only worker is free again"
    assert time.monotonic() - began < 15, "the task would have run for 30 s; test_cancel.py measures the delay"
    assert farm.jobs.get(job.id).counts["cancelled"] == 2
    with pytest.raises(Conflict):
        farm.jobs.cancel(job.id)


def test_a_cancelled_job_can_be_retried_and_deleted(farm: Farm, data: Path, tmp_path: Path) -> None:
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 3, "sleep_s": 0.2}))
    farm.jobs.cancel(job.id)
    assert farm.jobs.retry(job.id).state in ("queued", "running")
    assert finished(farm, job.id).state == "succeeded"
    farm.jobs.delete(job.id)
    with pytest.raises(NotFound):
        farm.jobs.get(job.id)
    assert (
        not list((tmp_path / "home" / "blobs" / "jobs").glob("**/*"))
        or not (tmp_path / "home" / "blobs" / "jobs" / job.id).exists()
    )


def test_a_paused_job_starts_nothing_until_it_resumes(open_farm: Callable[..., Farm], data: Path) -> None:
    farm = open_farm(workers=1)
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 6, "sleep_s": 0.1}))
    until(lambda: farm.jobs.get(job.id).steps[1].counts["running"])
    assert farm.jobs.pause(job.id).state == "paused"
    until(lambda: not farm.jobs.get(job.id).counts["running"])
    counts = farm.jobs.get(job.id).counts
    time.sleep(0.4)
    assert farm.jobs.get(job.id).counts == counts
    farm.jobs.resume(job.id)
    assert finished(farm, job.id).state == "succeeded"


def test_higher_priority_and_then_the_owner_with_fewest_tasks_is_served_first(
    open_farm: Callable[..., Farm], data: Path
) -> None:
    farm = open_farm(start=False, workers=1)
    low = farm.jobs.submit(request_on(farm, data, "anna"), owner="anna")
    high = farm.jobs.submit(request_on(farm, data, "ben", priority=5), owner="ben")
    farm.start()
    finished(farm, low.id)
    assert (farm.jobs.get(high.id).finished_at or 1e99) < (farm.jobs.get(low.id).finished_at or 0)


def test_requeue_runs_one_failed_task_again(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, params={"trouble": "bad-input"})).id)
    task = farm.tasks.page(job.id, state="failed").items[0]
    assert farm.tasks.requeue(task.id).state in ("ready", "running", "failed")
    assert finished(farm, job.id).state == "failed"
    assert len(farm.tasks.get(task.id).attempts) == 2


def test_a_repeated_submission_returns_the_same_job(farm: Farm, data: Path) -> None:
    request = request_on(farm, data, "anna")
    job = farm.jobs.submit(request, owner="anna", idempotency_key="k")
    assert job.new
    again = farm.jobs.submit(request, owner="anna", idempotency_key="k", admit=lambda: pytest.fail("it is no new job"))
    assert (again.id, again.new) == (job.id, False)
    assert farm.jobs.submit(request_on(farm, data, "ben"), owner="ben", idempotency_key="k").id != job.id
    with pytest.raises(IdempotencyMismatch):
        farm.jobs.submit(request_on(farm, data, seed=8), owner="anna", idempotency_key="k")


def test_events_are_listed_and_lost_ones_reported(open_farm: Callable[..., Farm], data: Path) -> None:
    farm = open_farm(events_kept=50)
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 5}))
    assert farm.jobs.wait_for_event(job.id, 1, 5.0)
    finished(farm, job.id)
    events, gone = farm.jobs.events(job.id)
    assert not gone
    assert [event.seq for event in events] == list(range(1, len(events) + 1))
    states = [event.data["state"] for event in events if event.type == "job.state"]
    assert states == ["queued", "running", "succeeded"]
    long = finished(farm, farm.jobs.submit(request_on(farm, data, params={"tasks": 80})).id)
    events, gone = farm.jobs.events(long.id)
    assert gone
    assert events[-1].data["state"] == "succeeded"
    assert len(events) < 160


def test_an_asset_in_use_cannot_be_deleted(farm: Farm, data: Path) -> None:
    request = request_on(farm, data, params={"sleep_s": 30})
    job = farm.jobs.submit(request)
    with pytest.raises(Conflict):
        farm.assets.delete(request.inputs["data"], "")
    farm.jobs.cancel(job.id)
    farm.assets.delete(request.inputs["data"], "")
    with pytest.raises(NotFound, match="Asset"):
        farm.jobs.submit(request)
    with pytest.raises(NotFound):
        farm.jobs.retry(job.id)


def test_a_finished_job_adds_a_message_to_the_outbox(farm: Farm, data: Path) -> None:
    job = finished(farm, farm.jobs.submit(request_on(farm, data, webhook="https://example.org/hook")).id)
    (message,) = farm.webhooks.due()
    assert (message.url, message.body["type"]) == ("https://example.org/hook", "job.succeeded")
    assert message.body["data"]["job_id"] == job.id
    assert farm.webhooks.due() == [], "claimed"
    assert farm.webhooks.record(message.id, 204).state == "delivered"


def test_operators_see_workers_queue_and_failures(farm: Farm, data: Path) -> None:
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 2, "sleep_s": 5}))
    until(lambda: farm.snapshot()["attempts_running"] == 2)
    assert farm.ready() == {"store": "ok", "blobs": "ok", "pool": "ok"}
    until(lambda: (farm.jobs.get(job.id).eta_s or 0) > 1)
    assert 0 < farm.jobs.get(job.id).progress < 1
    farm.jobs.cancel(job.id)


def test_an_orderly_stop_releases_running_tasks(open_farm: Callable[..., Farm], data: Path) -> None:
    farm = open_farm()
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 2, "sleep_s": 0.5}))
    until(lambda: farm.jobs.get(job.id).steps[1].counts["running"] == 2)
    farm.stop()
    again = open_farm()
    assert finished(again, job.id).state == "succeeded"
    outcomes = [attempt["outcome"] for task in again.tasks.page(job.id).items for attempt in task.attempts]
    assert outcomes.count("released") == 2
