"""The position of a job in the queue, and the same command about several jobs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pipeline.methods.base import Task
from tests.contracts.databases import DATABASES
from tests.contracts.test_stores import STEPS, Clock, _answer, _asset, _claim, _job, _plan
from workers.contract.record import RunState
from workers.contract.request import JobRequest
from workers.jobs import state_machine as machine
from workers.store import Accepted, Store, queue_position


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=DATABASES)
def store(request: pytest.FixtureRequest, clock: Clock) -> Iterator[Store]:
    opened = Store(DATABASES[request.param](request, True), now=clock)
    opened.assets.add(_asset("a" * 64), lambda: True)
    yield opened
    opened.close()


def _ahead(store: Store, job_id: str) -> int:
    return sum(each.jobs for each in store.jobs.ahead(job_id))


def test_before_a_job_are_the_owners_earlier_ones_and_as_many_of_each_other_owner_plus_one(store: Store) -> None:
    anna = [_job(store, "anna") for _ in range(6)]
    ben = [_job(store, "ben") for _ in range(2)]
    assert [_ahead(store, job_id) for job_id in anna] == [1, 3, 4, 5, 6, 7], "ben's two, and her earlier ones"
    assert [_ahead(store, job_id) for job_id in ben] == [1, 3], "one of hers, then two and his own"
    urgent = _job(store, "cleo", priority=1)
    assert _ahead(store, ben[0]) == 2 and _ahead(store, urgent) == 0
    store.jobs.command(urgent, machine.Pause())
    store.jobs.command(anna[0], machine.Cancel())
    assert _ahead(store, ben[0]) == 1 and _ahead(store, anna[1]) == 1


def test_the_rest_of_jobs_ahead_is_their_unfinished_weight(store: Store) -> None:
    request = JobRequest("toy", {"video": "ast_" + "a" * 64})
    for weights in ((1.0, 2.0, 1.0), (2.0, 4.0, 2.0)):
        store.jobs.add(Accepted(request, {}, STEPS, weights), "anna")
    last = _job(store, "anna")
    (ahead,) = store.jobs.ahead(last)
    assert (ahead.jobs, ahead.left) == (2, 3.0), "the second one has twice the weight of the first"
    _plan(store, Task("all", weight=1.0))
    assert store.queue.finish(_answer(_claim(store)))
    (ahead,) = store.jobs.ahead(last)
    assert ahead.left == pytest.approx((3 + 7) / 4), "a quarter of the first is done; the second has become smaller"


def test_jobs_ahead_are_counted_up_to_a_limit(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(queue_position, "MOST", 4)
    jobs = [_job(store, "anna") for _ in range(9)]
    assert [_ahead(store, job_id) for job_id in jobs] == [0, 1, 2, 3, 4, 5, 5, 5, 5], "one more tells that there are"


def test_a_command_about_several_jobs_tells_what_was_refused(store: Store, clock: Clock) -> None:
    queued, running, ended = (_job(store, "anna") for _ in range(3))
    store.jobs.command(ended, machine.Cancel())
    _plan(store, Task("one"))
    while _claim(store).job_id != running:
        pass
    clock.now += 5
    refused = store.bulk.command([running, "job_none", ended, queued], machine.Cancel())
    assert {job_id: error.code for job_id, error in refused.items()} == {"job_none": "not-found", ended: "conflict"}
    assert {store.jobs.get(job_id).state for job_id in (queued, running, ended)} == {RunState.CANCELLED}
    assert not store.queue.attempts_of("me")
    events, _ = store.events.list(running)
    assert events[-1].data["state"] == "cancelled"
    assert store.validation.validate_state() == []
    again = _job(store, "anna")
    assert store.bulk.remove([again, queued, running]).keys() == {again}
    assert [job.id for job in store.jobs.page().items] == [again, ended]
    counts = store.statistics.snapshot()
    assert {state: count for state, count in counts["jobs"].items() if count} == {"queued": 1, "cancelled": 1}
    assert not any(counts["tasks"].values())
    assert store.validation.validate_state() == []
