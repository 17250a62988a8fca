"""Jobs that another version of the program has planned: continued, planned again, or left to a newer program."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import update

from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from tests.workers.toy import Toy
from workers.farm import Farm
from workers.jobs.plan_versions import StepVersion, first_unreadable, is_newer
from workers.scheduling.step_planner import StepPlanner
from workers.scheduling.versions import is_readable
from workers.store import schema
from workers.store.claims import OtherVersion

STEPS = Toy.steps


@contextmanager
def program(*versions: int, reads: tuple[int, ...] = (), names: tuple[str, ...] = ()) -> Iterator[None]:
    """The program with these versions of the toy's steps."""
    names = names or tuple(step.name for step in STEPS)
    with pytest.MonkeyPatch.context() as patched:
        changed = (
            dataclasses.replace(step, version=version, reads=reads, name=name)
            for step, version, name in zip(STEPS, versions, names, strict=True)
        )
        patched.setattr(Toy, "steps", tuple(changed))
        yield


def _begun(open_farm: Callable[..., Farm], data: Path, tasks: int = 4) -> str:
    """A job of which two tasks are done."""
    farm = open_farm(workers=1)
    params = {"tasks": tasks, "chain": True, "sleep_s": 0.15}
    job = farm.jobs.submit(request_on(farm, data, params=params))
    until(lambda: len(farm.jobs.get(job.id).steps) > 1 and farm.jobs.get(job.id).steps[1].counts["succeeded"] >= 2)
    farm.stop()
    return job.id


def _undisturbed(open_farm: Callable[..., Farm], data: Path, tmp_path: Path, tasks: int = 4) -> bytes:
    farm = open_farm(home=tmp_path / "other")
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": tasks, "chain": True}))
    assert finished(farm, job.id).state == "succeeded"
    return result(farm, job.id)


def _attempts(farm: Farm, job_id: str) -> list[list[str]]:
    return [[attempt["outcome"] for attempt in task.attempts] for task in farm.tasks.page(job_id).items]


def _events(farm: Farm, job_id: str, kind: str) -> list[str]:
    return [event.data["message"] for event in farm.jobs.events(job_id)[0] if event.type == kind]


def test_a_running_job_of_an_older_version_is_planned_again_from_the_step_that_changed(
    open_farm: Callable[..., Farm], data: Path, tmp_path: Path
) -> None:
    job_id = _begun(open_farm, data)
    with program(1, 2):
        farm = open_farm()
        job = finished(farm, job_id)
        assert job.state == "succeeded"
        assert result(farm, job_id) == _undisturbed(open_farm, data, tmp_path)
    assert set(map(tuple, _attempts(farm, job_id))) == {("succeeded",)}, "none is charged"
    assert [warning.code for warning in job.warnings] == ["planned-again"]
    assert "from the step 'Draw'" in job.warnings[0].message
    assert _events(farm, job_id, "job.replanned") == [job.warnings[0].message]
    assert farm.validate_state() == []


def test_a_job_continues_from_a_version_that_its_steps_still_read(
    open_farm: Callable[..., Farm], data: Path, tmp_path: Path
) -> None:
    job_id = _begun(open_farm, data)
    with program(2, 2, reads=(1,)):
        farm = open_farm()
        job = finished(farm, job_id)
        assert job.state == "succeeded"
        assert job.warnings == ()
        assert _events(farm, job_id, "job.replanned") == []
        assert result(farm, job_id) == _undisturbed(open_farm, data, tmp_path)


def test_steps_may_be_renamed(open_farm: Callable[..., Farm], data: Path) -> None:
    job_id = _begun(open_farm, data)
    with program(2, 1, names=("analyze", "draw")):
        assert [step.name for step in finished(open_farm(), job_id).steps] == ["analyze", "draw", "assemble"]


@pytest.mark.parametrize("state", ["paused", "failed", "cancelled", "queued"])
def test_jobs_that_do_not_run_are_planned_again_when_they_do(
    state: str, open_farm: Callable[..., Farm], data: Path, tmp_path: Path
) -> None:
    farm = open_farm(workers=1, attempts=1)
    trouble = {"trouble": "once", "mark": str(tmp_path / "mark")} if state == "failed" else {}
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 3, "chain": True, "sleep_s": 0.1, **trouble}))
    if state == "failed":
        assert finished(farm, job.id).state == "failed"
    elif state != "queued":
        until(lambda: farm.jobs.get(job.id).steps[1].counts["running"])
        {"paused": farm.jobs.pause, "cancelled": farm.jobs.cancel}[state](job.id)
    farm.stop()
    with program(2, 2):
        farm = open_farm()
        if state == "paused":
            farm.jobs.resume(job.id)
        elif state != "queued":
            farm.jobs.retry(job.id)
        assert finished(farm, job.id).state == "succeeded"
        assert result(farm, job.id) == _undisturbed(open_farm, data, tmp_path, 3)
        assert farm.validate_state() == []


def test_a_job_of_a_newer_version_waits_and_says_so(open_farm: Callable[..., Farm], data: Path) -> None:
    with program(1, 2):
        job_id = _begun(open_farm, data)
    farm = open_farm()
    until(lambda: _events(farm, job_id, "job.waits"))
    other = farm.jobs.submit(request_on(farm, data))
    assert finished(farm, other.id).state == "succeeded", "it keeps no other job waiting"
    time.sleep(1.0)
    assert [task.state for task in farm.tasks.page(job_id).items].count("running") == 0
    assert len(_events(farm, job_id, "job.waits")) == 1
    farm.stop()
    with program(1, 2):
        farm = open_farm()
        assert finished(farm, job_id).state == "succeeded"
        assert _events(farm, job_id, "job.replanned") == []


def test_two_versions_work_on_one_database(open_farm: Callable[..., Farm], data: Path) -> None:
    """The programs take turns to claim; only the newer one may take what it has planned, and nothing is charged."""
    farm = open_farm(start=False)
    jobs = [farm.jobs.submit(request_on(farm, data, params={"tasks": 4, "chain": True})).id for _ in range(3)]
    planner = StepPlanner(farm.store)
    planner.plan()
    claimed = farm.store.queue.claim("old", 60, readable=is_readable)
    assert claimed is not None
    with program(1, 2), pytest.raises(OtherVersion) as error:
        farm.store.queue.claim("new", 60, [claimed.job_id], is_readable)
    with program(1, 2):
        newer = StepPlanner(farm.store)
        newer.take_over(claimed.job_id)
        assert claimed.job_id in newer.skipped, "the older program runs it"
        newer.take_over(error.value.job_id)
        assert error.value.job_id not in newer.skipped
        newer.plan()
        fresh = farm.store.queue.claim("new", 60, set(jobs) - {error.value.job_id}, is_readable)
        assert fresh is not None
        assert fresh.job_id == error.value.job_id
    farm.store.queue.postpone(fresh.attempt_id, 0.0, "")
    with pytest.raises(OtherVersion):
        farm.store.queue.claim("old", 60, set(jobs) - {error.value.job_id}, is_readable)


def test_data_without_versions_is_planned_again(open_farm: Callable[..., Farm], data: Path, tmp_path: Path) -> None:
    job_id = _begun(open_farm, data)
    farm = open_farm(start=False)
    with farm.store.database.write() as connection:
        connection.execute(update(schema.jobs).values(versions=None, planned_by=""))
    farm.stop()
    farm = open_farm()
    job = finished(farm, job_id)
    assert job.state == "succeeded"
    assert "an earlier version of Impasto began the job" in job.warnings[0].message
    assert result(farm, job_id) == _undisturbed(open_farm, data, tmp_path)


@pytest.mark.parametrize(
    ("stored", "newer", "unreadable"),
    [
        ([("scan", 1), ("paint", 2)], False, None),
        ([("scan", 1), ("paint", 1)], False, None),
        ([("scan", 1), ("paint", 0)], False, 1),
        ([], False, 0),
        ([("scan", 1), ("paint", 3)], True, 1),
        ([("scan", 2), ("draw", 1)], True, 0),
        ([("scan", 1), ("draw", 1), ("paint", 2)], False, 1),
        ([("scan", 1), ("paint", 2), ("more", 1)], False, 1),
    ],
)
def test_what_can_be_continued(stored: list[tuple[str, int]], newer: bool, unreadable: int | None) -> None:
    own = (StepVersion("scan", 1), StepVersion("paint", 2, reads=(1,)))
    assert is_newer(stored, own) == newer
    assert first_unreadable(stored, own) == unreadable
