"""`validate_state` finds nothing in a healthy farm, and every invariant that was broken by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from sqlalchemy import Connection, delete, insert, select, text, update

from pipeline.methods.base import Task
from tests.contracts.databases import COPIES, DATABASES
from workers.contract.order import TaskOutcome
from workers.contract.record import Asset, Fault, RunState, TaskState
from workers.contract.request import JobRequest
from workers.jobs import state_machine as machine
from workers.store import Accepted, Store, schema

ASSET = Asset("ast_" + "a" * 64, "a" * 64, 10, "cat.mp4", "video/mp4", "video", {"frames": 4}, 1.0, "anna")
HOUR_S = 3600.0


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(params=DATABASES)
def store(request: pytest.FixtureRequest, clock: Clock) -> Iterator[Store]:
    made = Store(DATABASES[request.param](request, True), now=clock)
    made.assets.add(ASSET, lambda: True)
    yield made
    made.close()


@pytest.fixture
def clock() -> Clock:
    return Clock()


def submit(store: Store, name: str, webhook: str = "") -> str:
    request = JobRequest("toy", {"video": ASSET.id}, name=name, webhook=webhook)
    accepted = Accepted(request, {}, (("draw", "Draw"), ("assemble", "Join")))
    return store.jobs.add(accepted, "anna").id


def plan(store: Store) -> None:
    for todo in store.plans.to_plan(100):
        tasks = [Task("assemble")] if todo.step else [Task("a"), Task("b", after=("a",)), Task("c")]
        assert store.plans.planned(todo.job_id, todo.step, tasks)


def finish(store: Store, attempt_id: str, event: machine.StateEvent | None = None) -> None:
    files = {"result": (f"jobs/{attempt_id}", "video/mp4")}
    assert store.queue.finish(TaskOutcome(attempt_id, {}, {}, files, None, {}, ""), event)


def mixed_run(store: Store) -> dict[str, str]:
    """A job in each state, by the name of the state; two attempts run."""
    ids = {name: submit(store, name, "https://example.org" if name == "failed" else "") for name in RunState}
    plan(store)
    store.jobs.command(ids["cancelled"], machine.Cancel())
    store.jobs.command(ids["paused"], machine.Pause())
    while claim := store.queue.claim("dsp_1", HOUR_S):
        if claim.job_id == ids["failed"]:
            finish(store, claim.attempt_id, machine.Failed(Fault("internal-error", "It broke."), final=True))
        elif claim.job_id == ids["succeeded"]:
            finish(store, claim.attempt_id)
            plan(store)
        elif claim.job_id == ids["queued"]:
            store.queue.postpone(claim.attempt_id, 200.0, "")
            store.jobs.command(ids["queued"], machine.Pause())
            store.jobs.command(ids["queued"], machine.Resume())
    return {name.value: job_id for name, job_id in ids.items()}


def test_a_consistent_store_has_no_violation(store: Store) -> None:
    assert store.validation.validate_state() == []
    ids = mixed_run(store)
    states = {name: store.jobs.get(job_id).state.value for name, job_id in ids.items()}
    assert {"running", "paused", "succeeded", "failed", "cancelled"} <= set(states.values()), states
    assert store.validation.validate_state() == []
    store.jobs.retry(ids["cancelled"])
    store.jobs.retry(ids["failed"])
    store.jobs.remove(ids["succeeded"])
    assert store.validation.validate_state() == []


def _running(connection: Connection) -> Any:
    query = select(schema.attempts).where(schema.attempts.c.outcome == "running").limit(1)
    return connection.execute(query).mappings().one()


def _set(connection: Connection, table: Any, key: str, value: str, **values: Any) -> None:
    assert connection.execute(update(table).where(table.c[key] == value).values(values)).rowcount


def lose_lease(connection: Connection, ids: dict[str, str]) -> str:
    attempt = _running(connection)
    _set(connection, schema.attempts, "id", attempt["id"], dispatcher="dsp_gone", started_at=1.0)
    return str(attempt["id"])


def run_in_final_job(connection: Connection, ids: dict[str, str]) -> str:
    attempts = schema.attempts
    query = select(attempts.c.id).where(attempts.c.job_id == ids["succeeded"]).limit(1)
    attempt_id = str(connection.execute(query).scalar_one())
    _set(connection, attempts, "id", attempt_id, outcome="running")
    return attempt_id


def forget_attempt(connection: Connection, ids: dict[str, str]) -> str:
    task_id = _running(connection)["task_id"]
    _set(connection, schema.tasks, "id", task_id, attempt_id=None)
    return str(task_id)


def replace_attempt(connection: Connection, ids: dict[str, str]) -> str:
    attempt = _running(connection)
    _set(connection, schema.tasks, "id", attempt["task_id"], attempt_id="att_other")
    return str(attempt["id"])


def _task(connection: Connection, job_id: str, state: TaskState) -> str:
    tasks = schema.tasks
    query = select(tasks.c.id).where(tasks.c.job_id == job_id, tasks.c.state == state.value).limit(1)
    return str(connection.execute(query).scalar_one())


def unfinish_task(connection: Connection, ids: dict[str, str]) -> str:
    task_id = _task(connection, ids["succeeded"], TaskState.SUCCEEDED)
    _set(connection, schema.tasks, "id", task_id, state="ready")
    return ids["succeeded"]


def succeed_too_early(connection: Connection, ids: dict[str, str]) -> str:
    _set(connection, schema.jobs, "id", ids["succeeded"], step=0)
    return ids["succeeded"]


def miscount(connection: Connection, ids: dict[str, str]) -> str:
    steps = schema.steps
    where = (steps.c.job_id == ids["paused"], steps.c.step == 0)
    connection.execute(update(steps).where(*where).values(waiting=steps.c.waiting + 1))
    return ids["paused"]


def hide_from_claims(connection: Connection, ids: dict[str, str]) -> str:
    _set(connection, schema.jobs, "id", ids["queued"], ready=9)
    return ids["queued"]


def deadlock(connection: Connection, ids: dict[str, str]) -> str:
    steps = schema.steps
    where = (steps.c.job_id == ids["paused"], steps.c.step == 0)
    connection.execute(update(steps).where(*where).values(ready=0, waiting=3))
    return ids["paused"]


def miscount_blockers(connection: Connection, ids: dict[str, str]) -> str:
    task_id = _task(connection, ids["paused"], TaskState.WAITING)
    _set(connection, schema.tasks, "id", task_id, blockers=2)
    return task_id


def free_too_early(connection: Connection, ids: dict[str, str]) -> str:
    task_id = _task(connection, ids["paused"], TaskState.WAITING)
    _set(connection, schema.tasks, "id", task_id, state="ready")
    return task_id


def forget_end(connection: Connection, ids: dict[str, str]) -> str:
    _set(connection, schema.jobs, "id", ids["cancelled"], finished_at=None)
    return ids["cancelled"]


def lose_message(connection: Connection, ids: dict[str, str]) -> str:
    connection.execute(delete(schema.deliveries))
    return ids["failed"]


def lose_event(connection: Connection, ids: dict[str, str]) -> str:
    _set(connection, schema.jobs, "id", ids["running"], last_seq=99)
    return ids["running"]


def lose_asset(connection: Connection, ids: dict[str, str]) -> str:
    connection.execute(delete(schema.assets))
    return ids["running"]


def orphan_message(connection: Connection, ids: dict[str, str]) -> str:
    connection.execute(text("ALTER TABLE deliveries DROP CONSTRAINT fk_deliveries_job_id"))
    row = {"id": "msg_1", "job_id": "job_gone", "owner": "anna", "url": "u", "body": {}, "created_at": 1.0}
    connection.execute(insert(schema.deliveries).values(**row, state="waiting", next_at=1.0))
    return "msg_1"


def lose_result(connection: Connection, ids: dict[str, str]) -> str:
    connection.execute(delete(schema.files).where(schema.files.c.job_id == ids["succeeded"]))
    return ids["succeeded"]


BREAKS: dict[Callable[[Connection, dict[str, str]], str], str] = {
    lose_lease: "attempt-without-lease",
    run_in_final_job: "attempt-not-current",
    replace_attempt: "attempt-not-current",
    forget_attempt: "task-without-attempt",
    unfinish_task: "unfinished-tasks",
    succeed_too_early: "unfinished-tasks",
    miscount: "wrong-counts",
    hide_from_claims: "wrong-ready-count",
    deadlock: "stuck-job",
    miscount_blockers: "wrong-blockers",
    free_too_early: "wrong-blockers",
    forget_end: "wrong-times",
    lose_message: "missing-message",
    lose_event: "events-ahead",
    lose_asset: "input-without-asset",
    orphan_message: "orphan",
    lose_result: "result-without-file",
}


@pytest.fixture(scope="module")
def runs() -> dict[str, tuple[str, dict[str, str]]]:
    """Database -> URL and job ids of a mixed run."""
    return {}


@pytest.fixture(params=DATABASES)
def mixed(request: pytest.FixtureRequest, clock: Clock, runs: dict[str, Any]) -> Iterator[tuple[Store, dict[str, str]]]:
    """A store after a mixed run, and the job ids: a copy, because the run takes ten times as long."""
    database = request.param
    if database not in runs:
        url = DATABASES[database](request, True)
        first = Store(url, now=clock)
        first.assets.add(ASSET, lambda: True)
        runs[database] = url, mixed_run(first)
        first.close()
    url, ids = runs[database]
    made = Store(COPIES[database](request, url), now=clock)
    yield made, ids
    made.close()


@pytest.mark.parametrize("break_it", BREAKS, ids=lambda act: act.__name__)
def test_a_broken_invariant_is_reported(
    break_it: Callable[[Connection, dict[str, str]], str], mixed: tuple[Store, dict[str, str]], clock: Clock
) -> None:
    store, ids = mixed
    clock.now += 600
    store.queue.renew("dsp_1", HOUR_S)
    if break_it is orphan_message and store.database.is_sqlite:
        with store.database.engine.connect() as connection:  # outside a transaction, where SQLite accepts this
            connection.exec_driver_sql("COMMIT")
            connection.exec_driver_sql("PRAGMA foreign_keys=OFF")
            row = "('msg_1', 'job_gone', 'anna', 'u', '{}', 1, 0, 'waiting', 1, '')"
            columns = "id, job_id, owner, url, body, created_at, tries, state, next_at, last_error"
            connection.exec_driver_sql(f"INSERT INTO deliveries ({columns}) VALUES {row}")
            connection.exec_driver_sql("PRAGMA foreign_keys=ON")
            connection.exec_driver_sql("BEGIN")
        broken = "msg_1"
    else:
        with store.database.write() as connection:
            broken = break_it(connection, ids)
    found = store.validation.validate_state()
    assert (BREAKS[break_it], broken) in {(one.kind, one.id) for one in found}
    assert all(one.message and one.remedy for one in found)


def test_a_consistency_check_is_bounded_and_read_only(store: Store) -> None:
    for number in range(12):
        submit(store, f"job {number}")
    with store.database.write() as connection:
        connection.execute(update(schema.jobs).values(finished_at=5.0))
    assert len(store.validation.validate_state(limit=3)) == 3
    with pytest.raises(Exception, match=r"(?i)read.?only"), store.database.snapshot() as connection:
        connection.execute(update(schema.jobs).values(finished_at=None))
