"""Inspection and control of the fleet by operators, on every database."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import pytest

from pipeline.errors import BadParameter
from pipeline.methods.base import Resources, Task
from tests.contracts.databases import DATABASES
from tests.contracts.test_stores import FAULT, Clock, _answer, _asset, _claim, _job, _plan
from workers.errors import NotFound
from workers.jobs import state_machine as machine
from workers.jobs.state_machine import Limits
from workers.operator_views import DrainScope, LiveView, Slot, WorkerInfo
from workers.store import Heartbeat, Store, StorePolicy

WHO = WorkerInfo("studio-1", "worker", "ray", "1.2.3")
SLOTS = (Slot("s0", "node-a", 2.0, 0.5, 1 << 30), Slot("s1", "node-b"))


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest) -> str:
    return DATABASES[request.param](request, True)


@pytest.fixture
def store(url: str, clock: Clock) -> Iterator[Store]:
    opened = Store(url, StorePolicy(Limits(2, 3), retry_delay_s=10), clock)
    opened.assets.add(_asset("a" * 64), lambda: True)
    yield opened
    opened.close()


def _enrol(store: Store, dispatcher: str = "me", lease_s: float = 30) -> None:
    store.queue.renew(dispatcher, lease_s)
    store.workers.register(dispatcher, WHO, SLOTS)


def test_a_worker_is_listed_with_its_slots_and_their_tasks(store: Store, clock: Clock) -> None:
    _enrol(store)
    job = _job(store)
    _plan(store, Task("one"))
    claim = _claim(store)
    store.queue.progress({claim.attempt_id: Heartbeat(0.25, "s0")})
    (worker,) = store.workers.workers().items
    assert (worker.id, worker.host, worker.role, worker.kind, worker.version) == (
        *("me", "studio-1", "worker", "ray"),
        "1.2.3",
    )
    assert (worker.state, worker.slots, worker.seen_at) == ("live", SLOTS, clock.now)
    (work,) = worker.at_work
    assert (work.attempt_id, work.job_id, work.step, work.key, work.number) == (
        *(claim.attempt_id, job, "analyze", "one"),
        1,
    )
    assert (work.progress, work.slot, work.node) == (0.25, "s0", "node-a")
    a, b = store.workers.nodes()
    assert (a.name, a.state, a.slots, a.busy, a.cpus, a.gpus, a.memory_bytes) == (
        *("node-a", "open"),
        *(1, 1, 2.0, 0.5, 1 << 30),
    )
    assert (b.name, b.busy, b.workers) == ("node-b", 0, ("me",))


def test_a_silent_worker_is_listed_as_away_and_a_retired_one_is_removed(store: Store, clock: Clock) -> None:
    _enrol(store)
    clock.now += 31
    (worker,) = store.workers.workers().items
    assert (worker.state, worker.seen_at) == ("away", clock.now - 31)
    assert store.workers.nodes() == []
    store.queue.renew("me", 30)
    assert store.workers.workers().items[0].state == "live"
    store.workers.drain(DrainScope.WORKER, "me")
    store.queue.retire("me")
    assert store.workers.workers().items == ()
    assert store.workers.drains() == [], "no worker of that name will return"


def test_a_worker_that_has_no_lease_has_no_slots(store: Store) -> None:
    store.workers.register("nobody", WHO, SLOTS)
    assert store.workers.nodes() == []


def test_workers_are_listed_in_pages(store: Store, clock: Clock) -> None:
    for number in range(5):
        _enrol(store, f"w{number}")
        clock.now += 1
    pages, cursor = [], None
    while True:
        page = store.workers.workers(cursor, 2)
        pages.append([worker.id for worker in page.items])
        if (cursor := page.cursor) is None:
            break
    assert pages == [["w0", "w1"], ["w2", "w3"], ["w4"]]
    with pytest.raises(BadParameter, match="cursor"):
        store.workers.workers("x")


def test_a_paused_queue_assigns_no_task_and_loses_none(store: Store) -> None:
    _job(store)
    _plan(store, Task("one"), Task("two"))
    running = _claim(store)
    first = store.workers.drain(DrainScope.QUEUE, by="key_1", reason="a leak")
    assert store.workers.drain(DrainScope.QUEUE, by="key_2") == first, "twice is the same as once"
    assert store.queue.claim("me", 30) is None
    assert store.queue.claim("other", 30) is None
    assert store.queue.finish(_answer(running)), "what runs goes on"
    store.workers.resume(DrainScope.QUEUE)
    store.workers.resume(DrainScope.QUEUE)
    assert _claim(store).task["key"] == "two"


def test_a_drained_worker_finishes_its_tasks_and_gets_no_new_ones(store: Store) -> None:
    for name in ("old", "new"):
        _enrol(store, name)
    _job(store)
    _plan(store, *(Task(f"t-{i}") for i in range(4)))
    claim = _claim(store, "old")
    store.workers.drain(DrainScope.WORKER, "old", "key_1", "upgrade")
    state = {worker.id: worker.state for worker in store.workers.workers().items}
    assert state == {"old": "draining", "new": "live"}
    assert store.queue.claim("old", 30) is None
    assert _claim(store, "new").task["key"] == "t-1"
    assert store.queue.finish(_answer(claim))
    (old,) = (worker for worker in store.workers.workers().items if worker.id == "old")
    assert (old.state, old.drain and old.drain.reason) == ("drained", "upgrade")
    store.workers.resume(DrainScope.WORKER, "old")
    assert _claim(store, "old").task["key"] == "t-2"


def test_a_machine_stays_drained_until_it_is_resumed(store: Store) -> None:
    _enrol(store)
    store.workers.drain(DrainScope.NODE, "node-a", "key_1")
    store.queue.retire("me")
    assert [(node.name, node.state, node.slots) for node in store.workers.nodes()] == [("node-a", "drained", 0)]
    _enrol(store, "its-next-life")
    assert [node.state for node in store.workers.nodes()] == ["drained", "open"]
    store.workers.resume(DrainScope.NODE, "node-a")
    assert [node.state for node in store.workers.nodes()] == ["open", "open"]


@pytest.mark.parametrize("place", [DrainScope.WORKER, DrainScope.NODE])
def test_an_unknown_worker_or_machine_cannot_be_drained(store: Store, place: DrainScope) -> None:
    with pytest.raises(NotFound, match="nobody"):
        store.workers.drain(place, "nobody")
    with pytest.raises(NotFound, match="nobody"):
        store.workers.resume(place, "nobody")


def test_failures_are_reported_newest_first_with_their_logs(store: Store, clock: Clock) -> None:
    jobs = [_job(store, name=f"job-{i}") for i in range(2)]
    _plan(store, Task("one"))
    failed = []
    for _ in jobs:
        claim = _claim(store)
        clock.now += 1
        answer = replace(_answer(claim), log=f"log of {claim.job_id}\nTraceback")
        assert store.queue.finish(answer, machine.Failed(FAULT, True), "s1")
        failed.append(claim.attempt_id)
    page = store.workers.failures(limit=1)
    assert [one.attempt_id for one in page.items] == failed[1:]
    assert [one.attempt_id for one in store.workers.failures(cursor=page.cursor).items] == failed[:1]
    (one,) = store.workers.failures(jobs[0]).items
    assert (one.job_name, one.job_state, one.task_state, one.outcome) == ("job-0", "failed", "failed", "failed")
    assert (one.slot, one.number, one.error and one.error["code"]) == ("s1", 1, FAULT.code)
    view = store.workers.attempt_log(failed[0])
    assert view.log == f"log of {jobs[0]}\nTraceback"
    with pytest.raises(NotFound):
        store.workers.attempt_log("att_none")


def test_a_timeline_has_every_attempt(store: Store, clock: Clock) -> None:
    job = _job(store)
    _plan(store, Task("one"), Task("two"))
    first = _claim(store)
    clock.now += 2
    assert store.queue.finish(_answer(first), machine.Failed(FAULT, False), "s0")
    clock.now += 400
    for _ in range(2):
        claim = _claim(store)
        clock.now += 3
        assert store.queue.finish(_answer(claim), worker="s1")
    bars = store.workers.timeline(job).items
    assert Counter((bar.key, bar.number, bar.outcome, bar.slot) for bar in bars) == Counter(
        [("one", 1, "failed", "s0"), ("one", 2, "succeeded", "s1"), ("two", 1, "succeeded", "s1")]
    )
    assert [bar.code for bar in bars if bar.code] == [FAULT.code]
    assert [bar.started_at for bar in bars] == sorted((bar.started_at for bar in bars), reverse=True)
    first_page = store.workers.timeline(job, limit=2)
    rest = store.workers.timeline(job, first_page.cursor, 2)
    assert (*first_page.items, *rest.items) == bars
    with pytest.raises(NotFound):
        store.workers.timeline("job_none")


def test_live_sessions_of_all_processes_are_listed_and_ended(store: Store, clock: Clock) -> None:
    def view(name: str) -> LiveView:
        return LiveView(name, "", "key_1", "abstraction", 640, 360, clock.now, True, {"painted": 3})

    assert store.workers.publish_live("p1", [view("liv_1"), view("liv_2")]) == set()
    assert store.workers.publish_live("p2", [view("liv_3")]) == set()
    assert [(one.id, one.process, one.figures) for one in store.workers.live().items] == [
        ("liv_1", "p1", {"painted": 3}),
        ("liv_2", "p1", {"painted": 3}),
        ("liv_3", "p2", {"painted": 3}),
    ]
    store.workers.end_live("liv_2")
    assert [one.ending for one in store.workers.live().items] == [False, True, False]
    assert store.workers.publish_live("p1", [view("liv_1"), view("liv_2")]) == {"liv_2"}
    assert store.workers.publish_live("p1", [view("liv_1")]) == {"liv_2"}
    assert [one.id for one in store.workers.live().items] == ["liv_1", "liv_3"]
    clock.now += 31
    assert store.workers.live().items == (), "their processes are gone"
    with pytest.raises(NotFound):
        store.workers.end_live("liv_9")


def test_the_resources_of_a_task_are_stored(store: Store) -> None:
    _job(store)
    _plan(store, Task("one", resources=Resources(2, 0.25, 1 << 30)), Task("two"))
    assert _claim(store).task["needs"] == {"cpus": 2, "gpus": 0.25, "memory_bytes": 1 << 30}
    assert _claim(store).task["needs"] is None
