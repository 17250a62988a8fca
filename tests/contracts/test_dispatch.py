"""Several processes on one store: fairness, liveness, visibility and cost."""

from __future__ import annotations

import random
import sqlite3
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import event, text

from pipeline.errors import StorageError
from pipeline.methods.base import Task
from tests.contracts.databases import DATABASES
from tests.contracts.test_stores import STEPS, Clock, _answer, _asset, _claim, _job, _plan
from tests.real.postgres import Postgres
from workers.contract.request import JobRequest
from workers.jobs import state_machine as machine
from workers.jobs.state_machine import Limits
from workers.store import Accepted, Store, StorePolicy

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest) -> str:
    return DATABASES[request.param](request, True)


def _open(url: str, clock: Clock | None = None, **policy: int) -> Store:
    store = Store(url, StorePolicy(Limits(2, 50), retry_delay_s=10, **policy), clock)  # type: ignore[arg-type]
    store.assets.add(_asset("a" * 64), lambda: True)
    return store


@pytest.fixture
def store(url: str, clock: Clock) -> Iterator[Store]:
    opened = _open(url, clock)
    yield opened
    opened.close()


# -- who is served


def _served(store: Store, n: int) -> list[str]:
    return [claim.job["owner"] for _ in range(n) if (claim := store.queue.claim("me", 30))]


def test_owners_are_served_in_turns_whatever_their_number_of_jobs(store: Store) -> None:
    for _ in range(30):
        _job(store, "anna")
    _plan(store, Task("x"), Task("y"))
    assert _served(store, 4) == ["anna"] * 4
    _job(store, "ben")
    _job(store, "cleo")
    _plan(store, *(Task(f"t-{i}") for i in range(8)))
    assert Counter(_served(store, 8)) == {"ben": 4, "cleo": 4}, "until they have as much as she"
    assert Counter(_served(store, 6)) == {"anna": 2, "ben": 2, "cleo": 2}


def _run(store: Store, clock: Clock, seconds: float) -> str:
    """Run the next task on the only slot for so long; returns its owner."""
    claim = _claim(store)
    clock.now += seconds
    assert store.queue.finish(_answer(claim))
    return str(claim.job["owner"])


def test_one_slot_serves_owners_in_turns(store: Store, clock: Clock) -> None:
    """A second owner's only job begins within three tasks, however many jobs the first one has and has had."""
    for _ in range(40):
        _job(store, "anna")
    _plan(store, Task("x"))
    assert [_run(store, clock, 5) for _ in range(10)] == ["anna"] * 10
    _job(store, "ben")
    _plan(store, Task("x"))
    assert "ben" in [_run(store, clock, 5) for _ in range(3)]


def test_one_slot_is_shared_by_time(store: Store, clock: Clock, url: str) -> None:
    """Also after a restart: anna's tasks take four times as long as ben's, and each gets half of the slot."""
    for owner in ("anna", "ben"):
        _job(store, owner)
    _plan(store, *(Task(f"t-{i}") for i in range(80)))
    length = {"anna": 8.0, "ben": 2.0}
    used = Counter[str]()
    for opened in (store, _open(url, clock)):
        for _ in range(20):
            claim = _claim(opened)
            owner = claim.job["owner"]
            used[owner] += length[owner]
            clock.now += length[owner]
            assert opened.queue.finish(_answer(claim))
    opened.close()
    assert abs(used["anna"] - used["ben"]) <= 8, used


def test_idle_time_is_not_saved_up(store: Store, clock: Clock) -> None:
    _job(store, "anna")
    _plan(store, *(Task(f"t-{i}") for i in range(40)))
    assert [_run(store, clock, 5) for _ in range(20)] == ["anna"] * 20
    _job(store, "ben")
    _plan(store, *(Task(f"t-{i}") for i in range(40)))
    assert Counter(_run(store, clock, 5) for _ in range(10)) == {"anna": 5, "ben": 5}


def test_cancelled_attempts_count_as_used_time(store: Store, clock: Clock) -> None:
    for owner in ("anna", "anna", "ben", "ben"):
        _job(store, owner)
    _plan(store, Task("x"))
    assert [_run(store, clock, 1) for _ in range(1)] == ["anna"]
    assert _claim(store).job["owner"] == "ben"
    clock.now += 50
    store.jobs.command(store.jobs.page("running", owner="ben").items[0].id, machine.Cancel())
    assert _claim(store).job["owner"] == "anna"


def test_steps_are_planned_in_turns(store: Store) -> None:
    """A second owner's job is planned within two, however many unplanned jobs the first one has."""
    for _ in range(50):
        _job(store, "anna")
    assert len(store.plans.to_plan(4)) == 4
    ben, urgent = _job(store, "ben"), _job(store, "anna", priority=1)
    found = [todo.job_id for todo in store.plans.to_plan(4)]
    assert found[0] == urgent and ben in found[1:3]
    assert ben not in [todo.job_id for todo in store.plans.to_plan(4, skipped=[ben])]


def test_owners_with_one_plan_at_a_time_take_turns(store: Store) -> None:
    for owner in ("anna", "ben", "cleo"):
        for _ in range(9):
            _job(store, owner)
    planned = []
    for _ in range(9):
        (todo,) = store.plans.to_plan(1)
        assert store.plans.planned(todo.job_id, todo.step, [Task("x")])
        planned.append(store.jobs.get(todo.job_id).owner)
    assert Counter(planned) == {"anna": 3, "ben": 3, "cleo": 3}


def test_jobs_of_an_owner_are_served_in_submission_order(store: Store) -> None:
    jobs = [_job(store, "anna") for _ in range(3)]
    _plan(store, Task("x"), Task("y"))
    assert [_claim(store).job_id for _ in range(6)] == [job for job in jobs for _ in range(2)]


def test_priority_precedes_fairness(store: Store) -> None:
    _job(store, "ben")
    _plan(store, Task("x"))
    _job(store, "anna", priority=1)
    _job(store, "anna", priority=-1)
    _plan(store, *(Task(f"t-{i}") for i in range(3)))
    assert _served(store, 9) == ["anna"] * 3 + ["ben"] + ["anna"] * 3


def test_running_tasks_of_a_key_are_limited(url: str, clock: Clock) -> None:
    store = _open(url, clock, owner_tasks=3)
    small, _ = store.keys.create("small", ["submit"], {"running_tasks": 1})
    large, _ = store.keys.create("large", ["submit"], {"running_tasks": 5})
    for owner in (small.owner, large.owner, "open"):
        _job(store, owner)
    _plan(store, *(Task(f"t-{i}") for i in range(8)))
    claims = []
    while (claim := store.queue.claim("me", 30)) is not None:
        claims.append(claim)
    assert Counter(claim.job["owner"] for claim in claims) == {small.owner: 1, large.owner: 5, "open": 3}
    assert store.queue.finish(_answer(claims[0]))
    assert _served(store, 2) == [claims[0].job["owner"]], "one place is free again"
    store.close()


def test_delayed_tasks_block_nobody(store: Store, clock: Clock) -> None:
    first, second = _job(store, priority=1), _job(store)
    _plan(store, Task("x"))
    assert store.queue.postpone(_claim(store).attempt_id, 100, "")
    assert _claim(store).job_id == second
    assert store.queue.claim("me", 30) is None
    clock.now += 101
    assert _claim(store).job_id == first


def test_a_clock_set_back_delays_no_task(store: Store, clock: Clock) -> None:
    _job(store)
    _plan(store, Task("x"))
    assert store.queue.postpone(_claim(store).attempt_id, 100, "")
    clock.now -= 7200
    assert _claim(store).task["key"] == "x"


# -- many dispatchers


def test_an_event_of_another_process_wakes_waiting_threads(url: str) -> None:
    here, there = _open(url), _open(url)
    job_id = _job(here)
    woken: list[bool] = []
    waiting = [threading.Thread(target=lambda: woken.append(here.events.wait(job_id, 1, 10))) for _ in range(3)]
    for thread in waiting:
        thread.start()
    time.sleep(0.1)
    began = time.monotonic()
    there.jobs.command(job_id, machine.Pause())
    for thread in waiting:
        thread.join()
    assert woken == [True] * 3
    assert time.monotonic() - began < 8
    assert not here.events.wait(job_id, 2, 0.05)
    there.jobs.command(job_id, machine.Cancel())
    gone = threading.Thread(target=lambda: woken.append(here.events.wait(job_id, 99, 10)))
    gone.start()
    there.jobs.remove(job_id)
    gone.join()
    assert woken == [True] * 4, "a job that is deleted wakes, too"
    here.close()
    there.close()


def test_live_dispatchers_are_listed_until_they_end(store: Store, clock: Clock) -> None:
    store.queue.renew("one", 30)
    clock.now += 10
    store.queue.renew("two", 30)
    assert store.queue.dispatchers() == ["one", "two"]
    clock.now += 25
    assert store.queue.dispatchers() == ["two"]
    store.queue.retire("two")
    assert store.queue.dispatchers() == []


def test_tasks_of_an_ended_dispatcher_are_released(store: Store) -> None:
    _job(store)
    _plan(store, Task("x"))
    claim = _claim(store, "old")
    store.queue.retire("old")
    assert store.queue.interrupt([]) == 1
    assert not store.queue.finish(_answer(claim))
    assert _claim(store, "new").task["id"] == claim.task["id"]


def test_dispatchers_killed_at_random_times_lose_no_work(url: str) -> None:
    """Three processes at 80 tasks; each is killed and replaced at random moments. Every task succeeds once."""
    store, chance = _open(url), random.Random(3)
    job_id = _job(store)
    _plan(store, *(Task(f"t-{i}", after=(f"t-{i - 7}",) if i % 8 == 7 else ()) for i in range(80)))
    working = [_claimer(url, f"d{i}-0") for i in range(3)]
    deaths, deadline = 0, time.monotonic() + 200
    while store.jobs.get(job_id).counts["succeeded"] < 80:
        assert time.monotonic() < deadline, store.jobs.get(job_id).counts
        time.sleep(chance.uniform(0.05, 0.2))
        if deaths < 3:
            deaths += 1
            chosen = chance.randrange(3)
            working[chosen].kill()
            working[chosen].wait()
            working[chosen] = _claimer(url, f"d{chosen}-{deaths}")
    for process in working:
        process.kill()
        process.wait()
    outcomes = [[attempt["outcome"] for attempt in task.attempts] for task in store.tasks.page(job_id, limit=200).items]
    assert all(found.count("succeeded") == 1 for found in outcomes)
    assert {outcome for found in outcomes for outcome in found} <= {"succeeded", "interrupted"}
    store.close()


def _claimer(url: str, name: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.contracts.claimer", url, name]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


# -- PostgreSQL alone


@pytest.fixture
def two(postgres: Postgres) -> Iterator[tuple[Store, Store]]:
    url = postgres.fresh()
    stores = _open(url), _open(url)
    yield stores
    for store in stores:
        store.close()


def test_a_job_locked_by_another_dispatcher_is_skipped(two: tuple[Store, Store]) -> None:
    one, other = two
    first, second = _job(one), _job(one)
    _plan(one, Task("x"))
    with one.queue._transaction(first):
        claim = other.queue.claim("other", 30)
    assert claim is not None and claim.job_id == second


def test_a_claim_waits_for_the_lock_of_the_only_job(two: tuple[Store, Store]) -> None:
    one, other = two
    job_id, claims = _job(one), []
    _plan(one, Task("x"), Task("y"))
    thread = threading.Thread(target=lambda: claims.append(other.queue.claim("other", 30)))
    with one.queue._transaction(job_id):
        thread.start()
        time.sleep(0.2)
        assert not claims
    thread.join()
    assert claims[0] is not None


def test_leases_use_the_clock_of_the_database_server(two: tuple[Store, Store], monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = two
    _job(one)
    _plan(one, Task("x"))
    assert one.queue.claim("one", 30) is not None
    monkeypatch.setattr("time.time", lambda: 4e9)
    assert abs(other.database.now() - one.database.now()) < 1
    assert other.queue.interrupt([]) == 0, "a machine whose clock is wrong takes nothing away"


def test_an_asset_added_during_a_sweep_is_kept_or_swept_consistently(two: tuple[Store, Store]) -> None:
    """`unless_known` holds the name: who adds meanwhile waits, and then sees that the bytes are gone."""
    one, other = two
    bytes_there, added = [True], []
    forgetting, thread = threading.Event(), threading.Thread()

    def forget() -> None:
        forgetting.set()
        time.sleep(0.2)
        bytes_there.clear()

    def add() -> None:
        forgetting.wait()
        added.append(other.assets.add(_asset("c" * 64), lambda: bool(bytes_there)))

    thread = threading.Thread(target=add)
    thread.start()
    one.assets.unless_known("ast_" + "c" * 64, forget)
    thread.join()
    assert added == [None]


def test_concurrent_uploads_of_one_asset_succeed(two: tuple[Store, Store]) -> None:
    owners = [f"owner-{i}" for i in range(8)]
    threads = [
        threading.Thread(target=two[i % 2].assets.add, args=(_asset("d" * 64, owner), lambda: True))
        for i, owner in enumerate(owners)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [two[0].assets.get("ast_" + "d" * 64, owner).owner for owner in owners] == owners


def test_an_unreachable_server_is_reported_and_comes_back(postgres: Postgres) -> None:
    store = _open(postgres.fresh())
    postgres.stop()
    try:
        began = time.monotonic()
        with pytest.raises(StorageError) as error:
            store.check()
        assert error.value.remedy
        with pytest.raises(StorageError):
            store.queue.claim("me", 30)
        assert time.monotonic() - began < 30
    finally:
        postgres.start()
    store.check()
    _job(store)
    store.close()


# -- what it costs


def _effort(store: Store) -> int:
    """Virtual machine steps of SQLite for two claims and answers: the same number on any computer."""
    steps = [0]

    def count() -> int:
        steps[0] += 1
        return 0

    def inspect(connection: sqlite3.Connection, *_: object) -> None:
        connection.set_progress_handler(count, 10)

    event.listen(store.database.engine, "checkout", inspect)
    for _ in range(2):
        claim = store.queue.claim("me", 30)
        assert claim is not None
        assert store.queue.finish(_answer(claim))
    event.remove(store.database.engine, "checkout", inspect)
    return steps[0]


def _fill(store: Store, jobs: int, tasks: int) -> None:
    """Insert rows as planning would, quickly."""
    for i in range(jobs):
        request = JobRequest("toy", {"video": "ast_" + "a" * 64})
        store.jobs.add(Accepted(request, {}, STEPS), f"owner-{i % 5}")
    _plan(store, Task("one"))
    big = _job(store, "big", priority=1)
    _plan(store, *(Task(f"t-{i}") for i in range(tasks)))
    with store.database.write() as connection:  # as if half of it had been done
        done = {"job": big, "half": tasks // 2}
        connection.execute(text("UPDATE tasks SET state = 'succeeded' WHERE job_id = :job AND position <= :half"), done)
        connection.execute(
            text(
                "INSERT INTO attempts (id, task_id, job_id, number, dispatcher, worker, outcome, started_at, log,"
                " finished_at) SELECT 'att_' || id, id, job_id, 1, 'me', 'w', 'succeeded', 1, '', 2 FROM tasks"
                " WHERE job_id = :job AND position <= :half"
            ),
            done,
        )


def test_the_cost_of_a_claim_is_independent_of_the_queue_length(tmp_path: Path, clock: Clock) -> None:
    """Counts steps instead of time; `python -m benchmarks.dispatch` times up to 100,000 tasks and 10,000 jobs."""
    efforts = []
    for jobs, tasks in ((10, 100), (100, 4000)):
        store = _open(f"sqlite:///{tmp_path / f'{tasks}.db'}", clock)
        event.listen(store.database.engine, "connect", lambda made, _: made.execute("PRAGMA synchronous=OFF"))
        _fill(store, jobs, tasks)
        efforts.append(_effort(store))
        store.close()
    assert efforts[1] < 1.1 * efforts[0], efforts
