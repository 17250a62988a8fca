"""The contract of the job store, on every database."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import event, select

from pipeline.errors import BadParameter, StorageError
from pipeline.methods.base import Task
from tests.contracts.databases import DATABASES
from workers.contract.order import TaskOutcome
from workers.contract.record import ANY_OWNER, Asset, Fault
from workers.contract.request import JobRequest
from workers.errors import Conflict, NotFound, QuotaExceeded
from workers.jobs import state_machine as machine
from workers.jobs.state_machine import Limits
from workers.store import Accepted, Claim, Heartbeat, Store, StorePolicy, schema

STEPS = (("analyze", "Analyze"), ("draw", "Draw"), ("assemble", "Join"))


class Clock:
    now = 1_000_000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=DATABASES)
def url(request: pytest.FixtureRequest) -> str:
    return DATABASES[request.param](request, True)


@pytest.fixture
def store(url: str, clock: Clock) -> Iterator[Store]:
    opened = Store(url, StorePolicy(Limits(2, 3), retry_delay_s=10, events_kept=200), clock)
    opened.assets.add(_asset("a" * 64), lambda: True)
    yield opened
    opened.close()


def _asset(sha: str, owner: str = "", filename: str = "cat.mp4") -> Asset:
    return Asset(f"ast_{sha}", sha, 10, filename, "video/mp4", "video", {"width": 64, "frames": 9}, 1.5, owner)


def _job(store: Store, owner: str = "", key: str = "", **changes: object) -> str:
    request = JobRequest(**{"method": "toy", "inputs": {"video": "ast_" + "a" * 64}, **changes})  # type: ignore[arg-type]
    return store.jobs.add(Accepted(request, {}, STEPS), owner, key).id


def _plan(store: Store, *tasks: Task) -> None:
    for todo in store.plans.to_plan(100):
        assert store.plans.planned(todo.job_id, todo.step, tasks or (Task("one"),))


def _claim(store: Store, dispatcher: str = "me") -> Claim:
    claim = store.queue.claim(dispatcher, 30)
    assert claim is not None
    return claim


def _answer(claim: Claim, **changes: object) -> TaskOutcome:
    given = {"result": {"n": 1}, "artefacts": {}, "files": {}, "segment": None, "stages": {"method": 2.0}, "log": "ok"}
    return TaskOutcome(claim.attempt_id, **{**given, **changes})  # type: ignore[arg-type]


FAULT = Fault("internal-error", "It broke.", "Mend it.")


def test_no_number_of_threads_exceeds_the_quota_of_active_jobs(store: Store) -> None:
    accepted = Accepted(JobRequest("toy", {"video": "ast_" + "a" * 64}), {}, STEPS)
    together, refused = threading.Barrier(30), []

    def submit() -> None:
        together.wait()
        try:
            store.jobs.add(accepted, "me", max_active=3)
        except QuotaExceeded as error:
            refused.append(error.field)

    threads = [threading.Thread(target=submit) for _ in range(30)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(store.jobs.page(owner="me").items) == 3
    assert refused == ["active_jobs"] * 27
    store.jobs.add(accepted, "another", max_active=3)


def test_migrations_make_the_tables_of_the_schema(store: Store) -> None:
    with store.database.read() as connection:
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []


def test_a_job_persists_when_the_store_is_reopened(store: Store, url: str) -> None:
    job_id = _job(store, labels={"shot": "12"}, name="cat")
    again = Store(url)
    assert again.jobs.get(job_id) == store.jobs.get(job_id)
    again.close()


def test_results_artefacts_and_segments_reach_later_steps(store: Store) -> None:
    job_id = _job(store)
    _plan(store, Task("all"))
    assert store.queue.finish(_answer(_claim(store), artefacts={"analyze/cuts": "k1"}, result={"cuts": [3]}))
    _plan(store, Task("b", emits=(4, 8)), Task("a", emits=(0, 4)))
    assert store.task_inputs.before(job_id, 1) == ({"analyze": {"all": {"cuts": [3]}}}, {"analyze/cuts": "k1"})
    for _ in range(2):
        claim = _claim(store)
        assert store.queue.finish(_answer(claim, segment=f"seg-{claim.task['key']}"))
    assert store.task_inputs.segments(job_id) == ((0, 4, "seg-a"), (4, 8, "seg-b"))
    assert store.task_inputs.stages(job_id, 2) == {"analyze": {"method": 2.0}, "draw": {"method": 4.0}}
    _plan(store, Task("assemble"))
    assert store.queue.finish(_answer(_claim(store), files={"result": ("k", "video/mp4")}))
    job = store.jobs.get(job_id)
    assert (job.state, job.results, job.progress) == ("succeeded", ("result",), 1.0)
    assert [step.seconds for step in job.steps] == [2.0, 4.0, 2.0]


def test_a_task_gets_only_the_artefacts_of_its_chain(store: Store) -> None:
    _job(store)
    _plan(store, Task("all"))
    assert store.queue.finish(_answer(_claim(store)))
    _plan(store, Task("a"), Task("b", after=("a",)), Task("other"), Task("c", after=("b", "a")))
    for _ in range(3):
        claim = _claim(store)
        assert store.queue.finish(_answer(claim, artefacts={f"draw/{claim.task['key']}": f"k-{claim.task['key']}"}))
    assert store.task_inputs.chain(_claim(store).task["id"]) == (("a", "b"), {"draw/a": "k-a", "draw/b": "k-b"})


def test_a_task_depends_on_tasks_of_any_earlier_step(store: Store) -> None:
    job_id = _job(store)
    _plan(store, Task("a"), Task("b"))
    for _ in range(2):
        claim = _claim(store)
        assert store.queue.finish(_answer(claim, artefacts={f"analyze/{claim.task['key']}": f"k-{claim.task['key']}"}))
    _plan(store, Task("one", after=("analyze/b",)), Task("two", after=("one", "analyze/a", "analyze/b")))
    assert [(task.key, task.state) for task in store.tasks.page(job_id).items[2:]] == [
        ("one", "ready"),
        ("two", "waiting"),
    ]
    claim = _claim(store)
    assert store.task_inputs.chain(claim.task["id"]) == (("analyze/b",), {"analyze/b": "k-b"})
    assert store.queue.finish(_answer(claim, artefacts={"draw/one": "k-one"}))
    chain = store.task_inputs.chain(_claim(store).task["id"])
    assert chain == (("analyze/a", "analyze/b", "one"), {"analyze/a": "k-a", "analyze/b": "k-b", "draw/one": "k-one"})


def test_the_preview_of_a_running_task_is_a_job_file_until_replaced(store: Store) -> None:
    job_id = _job(store)
    _plan(store)
    claim = _claim(store)
    for number in range(3):
        store.queue.progress({claim.attempt_id: Heartbeat(0.1 * number, "w-1", f"live-{number}")})
    shown = store.jobs.file(job_id, "preview")
    assert shown is not None
    assert (shown["key"], store.jobs.get(job_id).results) == ("live-2", ("preview",))
    assert store.queue.finish(_answer(claim, files={"preview": ("last", "image/jpeg")}))
    store.queue.progress({claim.attempt_id: Heartbeat(0.9, preview="late")})
    assert store.jobs.blob_keys(job_id) == {"last"}


def test_a_late_answer_is_ignored(store: Store, clock: Clock) -> None:
    job_id = _job(store)
    _plan(store)
    late = _claim(store, "dead")
    clock.now += 31
    assert store.queue.interrupt([]) == 1, "its lease is over"
    newer = _claim(store, "alive")
    assert newer.task["id"] == late.task["id"]
    before = store.jobs.get(job_id), store.events.list(job_id)
    assert not store.queue.finish(_answer(late, result={"wrong": 1}, files={"result": ("wrong", "x/y")}))
    assert not store.queue.finish(_answer(late), machine.Failed(FAULT))
    assert not store.queue.postpone(late.attempt_id, 0, "")
    store.queue.progress({late.attempt_id: Heartbeat(0.9, preview="late")})
    assert (store.jobs.get(job_id), store.events.list(job_id)) == before
    assert store.queue.finish(_answer(newer))
    assert not store.queue.finish(_answer(newer)), "an answer counts once"
    assert not store.queue.finish(TaskOutcome("att_unknown", {}, {}, {}, None, {}, ""))


def test_tasks_of_a_dead_dispatcher_are_reassigned_before_the_lease_ends(store: Store) -> None:
    _job(store)
    _plan(store)
    claim = _claim(store, "dead")
    assert store.queue.claim("me", 30) is None
    store.queue.renew("me", 30)
    assert store.queue.interrupt(["dead"]) == 1
    assert _claim(store).task["id"] == claim.task["id"]


def test_failed_attempts_back_off_and_then_fail_the_job(store: Store, clock: Clock) -> None:
    job_id = _job(store)
    _plan(store, Task("one"), Task("two"))
    claim = _claim(store)
    assert store.queue.finish(_answer(claim, log="first try"), machine.Failed(FAULT))
    other = _claim(store)
    assert other.task["key"] == "two", "the first one is to wait"
    assert store.queue.claim("me", 30) is None
    clock.now += 11
    assert store.queue.finish(_answer(_claim(store), log="second try"), machine.Failed(FAULT))
    assert store.jobs.get(job_id).state == "running", "what runs beside it may end"
    assert store.queue.finish(_answer(other))
    job = store.jobs.get(job_id)
    assert (job.state, job.error) == ("failed", FAULT)
    assert store.tasks.log(claim.task["id"]).count("try") == 2
    store.jobs.retry(job_id)
    assert _claim(store).task["key"] == "one", "only what failed"


def test_tasks_of_a_chain_become_ready_one_by_one(store: Store) -> None:
    _job(store)
    _plan(store, Task("c", after=("a", "b")), Task("a"), Task("b"))
    first, second = _claim(store), _claim(store)
    assert store.queue.claim("me", 30) is None
    store.queue.finish(_answer(first))
    assert store.queue.claim("me", 30) is None
    store.queue.finish(_answer(second))
    assert _claim(store).task["key"] == "c"


def test_cancelling_ends_attempts_and_a_retry_runs_the_remaining_tasks(store: Store) -> None:
    job_id = _job(store)
    _plan(store, Task("a"), Task("b", after=("a",)), Task("c"))
    store.queue.finish(_answer(_claim(store)))
    running = _claim(store)
    store.jobs.command(job_id, machine.Cancel())
    assert store.queue.attempts_of("me") == set()
    assert not store.queue.finish(_answer(running))
    counts = store.jobs.get(job_id).counts
    assert (counts["succeeded"], counts["cancelled"]) == (1, 2)
    store.jobs.retry(job_id)
    assert {_claim(store).task["key"], _claim(store).task["key"]} == {"b", "c"}
    with pytest.raises(Conflict):
        store.jobs.remove(job_id)


def _states(store: Store, job_id: str, state: str | None = None) -> dict[str, str]:
    return {task.key: task.state.value for task in store.tasks.page(job_id, state).items}


def test_every_query_lists_tasks_of_a_cancelled_job_as_cancelled(store: Store) -> None:
    job_id = _job(store)
    _plan(store, Task("a"), Task("b"), Task("c", after=("b",)), Task("d"))
    store.queue.finish(_answer(_claim(store)))
    running = _claim(store)
    store.jobs.command(job_id, machine.Cancel())
    wanted = {"a": "succeeded", "b": "cancelled", "c": "cancelled", "d": "cancelled"}
    assert _states(store, job_id) == wanted
    for state in ("waiting", "ready", "running", "succeeded", "failed", "cancelled"):
        assert _states(store, job_id, state) == {key: is_in for key, is_in in wanted.items() if is_in == state}
    assert store.tasks.get(running.task["id"]).attempts[0]["outcome"] == "cancelled"
    assert store.statistics.snapshot()["tasks"]["cancelled"] == 3
    assert store.queue.claim("me", 30) is None


def test_one_task_of_a_cancelled_job_can_be_requeued_alone(store: Store) -> None:
    job_id = _job(store)
    _plan(store, Task("a"), Task("b"), Task("c", after=("b",)), Task("d"))
    store.jobs.command(job_id, machine.Cancel())
    ids = {task.key: task.id for task in store.tasks.page(job_id).items}
    with pytest.raises(Conflict, match="waits"):
        store.jobs.requeue(ids["c"])
    store.jobs.requeue(ids["b"])
    assert _states(store, job_id) == {"a": "cancelled", "b": "ready", "c": "cancelled", "d": "cancelled"}
    claim = _claim(store)
    assert claim.task["key"] == "b" and store.queue.claim("me", 30) is None
    store.queue.finish(_answer(claim))
    assert store.jobs.get(job_id).state == "cancelled", "the rest of it is, still"
    store.jobs.retry(job_id)
    assert _states(store, job_id) == {"a": "ready", "b": "succeeded", "c": "ready", "d": "ready"}


def test_a_retry_after_a_cancel_keeps_chains_and_gives_a_fresh_budget(store: Store, clock: Clock) -> None:
    job_id = _job(store)
    _plan(store, Task("a"), Task("b", after=("a",)))
    store.queue.finish(_answer(_claim(store)), machine.Failed(FAULT))
    store.jobs.command(job_id, machine.Cancel())
    store.jobs.retry(job_id)
    counts = store.jobs.get(job_id).counts
    assert (counts["ready"], counts["waiting"], counts["cancelled"]) == (1, 1, 0)
    claim = _claim(store)
    assert (claim.task["key"], claim.task["failures"]) == ("a", 0), "at once, as if it had not failed"
    store.queue.finish(_answer(claim))
    assert _claim(store).task["key"] == "b"


def test_cancelling_a_large_job_changes_as_few_rows_as_a_small_one(store: Store) -> None:
    changed = []
    engine = store.database.engine
    event.listen(engine, "after_cursor_execute", lambda c, cursor, *_: changed.append(max(0, cursor.rowcount)))
    found = []
    for tasks in (4, 400):
        job_id = _job(store)
        _plan(store, *(Task(f"t-{i}", after=("t-0",) if i > 2 else ()) for i in range(tasks)))
        _claim(store)
        changed.clear()
        store.jobs.command(job_id, machine.Cancel())
        found.append(sum(changed))
        assert store.jobs.get(job_id).counts["cancelled"] == tasks
    assert found[0] == found[1]


def test_no_task_of_a_paused_job_is_claimed(store: Store) -> None:
    job_id = _job(store)
    _plan(store)
    store.jobs.command(job_id, machine.Pause())
    assert store.queue.claim("me", 30) is None
    assert store.plans.to_plan() == []
    store.jobs.command(job_id, machine.Resume())
    assert _claim(store).job_id == job_id


def test_the_order_of_service_follows_priority_and_owner(store: Store) -> None:
    anna = [_job(store, "anna") for _ in range(3)]
    ben = _job(store, "ben")
    urgent = _job(store, "anna", priority=1)
    _plan(store, Task("x"), Task("y"))
    served = [_claim(store).job_id for _ in range(5)]
    assert served[:2] == [urgent, urgent]
    assert served[2:] == [ben, ben, anna[0]], "an owner with less at work goes first"


def test_a_step_is_planned_once(store: Store) -> None:
    job_id = _job(store)
    assert store.plans.planned(job_id, 0, (Task("a"),))
    assert not store.plans.planned(job_id, 0, (Task("b"),))
    assert not store.plans.planned("job_gone", 0, (Task("b"),))
    assert [task.key for task in store.tasks.page(job_id).items] == ["a"]


def test_many_threads_claim_every_task_once(store: Store) -> None:
    _job(store)
    _plan(store, *(Task(f"t-{i}") for i in range(40)))
    claimed: list[str] = []

    def work(name: str) -> None:
        while (claim := store.queue.claim(name, 30)) is not None:
            claimed.append(claim.task["key"])
            store.queue.finish(_answer(claim))

    threads = [threading.Thread(target=work, args=(f"d{i}",)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(claimed) == sorted(f"t-{i}" for i in range(40))


def test_jobs_are_searched_by_name_method_and_labels(store: Store) -> None:
    swan = _job(store, name="Swan lake", labels={"scene": "12", "draft": ""})
    _job(store, name="100 % wool")
    for search in ("swan", "LAKE swan", "scene:12", "lake draft:"):
        assert [job.id for job in store.jobs.page(search=search).items] == [swan], search
    assert store.jobs.page(search="swan scene:13").items == ()
    assert store.jobs.page(search="1_0").items == (), "no letter stands for others"
    assert len(store.jobs.page(search="0 % wool").items) == 1


def test_pagination_has_no_gaps_while_jobs_arrive(store: Store) -> None:
    made = [_job(store, labels={"n": str(i % 2)}) for i in range(7)]
    first = store.jobs.page(limit=3)
    _job(store)
    second = store.jobs.page(limit=3, cursor=first.cursor)
    third = store.jobs.page(limit=3, cursor=second.cursor)
    listed = [job.id for page in (first, second, third) for job in page.items]
    assert listed == made[::-1]
    assert third.cursor is None
    assert len(store.jobs.page(label=("n", "1")).items) == 3
    assert store.jobs.page(state="failed").items == ()
    assert len(store.jobs.page(state="active").items) == 8
    with pytest.raises(BadParameter):
        store.jobs.page(cursor="nonsense")
    with pytest.raises(BadParameter):
        store.jobs.page(state="asleep")


def test_unstorable_text_is_a_user_error(store: Store) -> None:
    for ask in (
        lambda: store.jobs.get("job_\ud800"),
        lambda: _job(store, labels={"a": "\ud800"}),
        lambda: _job(store, inputs={"video": "ast_\ud800"}),
    ):
        with pytest.raises(BadParameter):
            ask()


def test_tasks_are_listed_in_plan_order(store: Store) -> None:
    job_id = _job(store)
    _plan(store, *(Task(f"t-{i}") for i in range(5)))
    first = store.tasks.page(job_id, limit=2)
    rest = store.tasks.page(job_id, cursor=first.cursor)
    assert [task.key for task in (*first.items, *rest.items)] == [f"t-{i}" for i in range(5)]
    with pytest.raises(NotFound):
        store.tasks.page("job_gone")


def test_history_is_bounded_and_reports_lost_events(store: Store) -> None:
    job_id = _job(store)
    for _ in range(150):
        store.jobs.command(job_id, machine.Pause())
        store.jobs.command(job_id, machine.Resume())
    events, gone = store.events.list(job_id, after=10, limit=1000)
    assert gone
    assert 200 <= len(events) < 300
    assert not store.events.list(job_id, after=events[0].seq)[1]
    assert store.events.list(job_id, after=events[-1].seq) == ([], False)
    assert not store.events.wait(job_id, events[-1].seq, 0.01)
    assert store.events.wait(job_id, events[-1].seq - 1, 0.01)


def test_the_same_bytes_are_one_asset_with_several_owners(store: Store) -> None:
    store.assets.add(_asset("b" * 64, "anna", "mine.mp4"), lambda: True)
    assert store.assets.add(_asset("b" * 64, "ben", "his.mp4"), lambda: True) == _asset("b" * 64, "ben", "his.mp4")
    assert [asset.filename for asset in store.assets.page("anna").items] == ["mine.mp4"]
    assert len(store.assets.page(ANY_OWNER).items) == 2
    assert not store.assets.remove("ast_" + "b" * 64, "anna")
    with pytest.raises(NotFound):
        store.assets.get("ast_" + "b" * 64, "anna")
    assert store.assets.remove("ast_" + "b" * 64, "ben")
    with pytest.raises(NotFound):
        store.assets.get("ast_" + "b" * 64, ANY_OWNER)
    assert store.assets.add(_asset("b" * 64), lambda: False) is None, "its bytes went in between"


def test_keys_are_shown_once_and_verified(store: Store) -> None:
    key, secret = store.keys.create("anna", ["submit", "read"], {"active_jobs": 2})
    assert store.keys.verify(secret) == key
    key = store.keys.get(key.id)
    assert key.used_at is not None and store.keys.verify(secret) == key, "the use is noted once an hour"
    assert key.scopes == {"read", "submit"}
    for wrong in ("", "impasto_", secret[:-1], secret + "x", secret.replace("impasto_", "other_"), "\ud800"):
        assert store.keys.verify(wrong) is None
    with store.database.read() as connection:
        assert secret.rpartition("_")[2] not in str(connection.execute(select(schema.api_keys)).all())
    _job(store, key.owner)
    assert store.keys.usage(key.owner) == {"active_jobs": 1, "asset_bytes": 0}
    revoked = store.keys.revoke(key.id)
    assert store.keys.verify(secret) is None
    assert store.keys.revoke(key.id) == revoked
    assert store.keys.list() == [revoked]
    with pytest.raises(BadParameter):
        store.keys.create("ben", ["everything"])
    with pytest.raises(NotFound):
        store.keys.revoke("key_none")


def test_webhook_deliveries_back_off_and_finally_die(store: Store, clock: Clock) -> None:
    job_id = _job(store, webhook="https://example.org")
    store.jobs.command(job_id, machine.Cancel())
    (message,) = store.webhooks.due()
    assert message.body["type"] == "job.cancelled"
    assert store.webhooks.due() == []
    clock.now += 61
    assert [again.id for again in store.webhooks.due()] == [message.id], "the process that claimed it died"
    waits = []
    while (state := store.webhooks.record(message.id, 500)).state == "waiting":
        assert state.next_at is not None
        waits.append(state.next_at - clock.now)
    assert waits == sorted(waits)
    assert waits[:2] == [5, 300]
    assert (state.state, state.last_error) == ("dead", "HTTP 500")
    assert store.webhooks.of_job(job_id) == [state]


def test_a_webhook_answered_with_410_is_not_retried(store: Store) -> None:
    store.jobs.command(_job(store, webhook="https://example.org"), machine.Cancel())
    (message,) = store.webhooks.due()
    assert store.webhooks.record(message.id, 410).state == "dead"


def test_a_database_that_cannot_be_opened_is_a_storage_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "broken.db").write_bytes(b"this is not a database, whatever its file name is" * 50)
    with pytest.raises(StorageError):
        Store(f"sqlite:///{tmp_path / 'broken.db'}")
    with pytest.raises(StorageError):
        Store(f"sqlite:///{tmp_path / 'file' / 'impasto.db'}")


def test_claiming_and_finishing_scan_no_whole_table(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every statement must find its rows by an index: a scan of 100,000 tasks would be visible."""
    job_id = _job(store)
    _plan(store, *(Task(f"t-{i}", after=("t-0",) if i > 5 else ()) for i in range(500)))
    statements: list[tuple[str, object]] = []
    engine = store.database.engine
    event.listen(engine, "before_cursor_execute", lambda c, cursor, text, given, *_: statements.append((text, given)))
    for _ in range(2):
        claim = _claim(store)
        store.queue.progress({claim.attempt_id: Heartbeat(0.5)})
        store.queue.renew("me", 30)
        store.queue.finish(_answer(claim))
    store.jobs.get(job_id)
    store.tasks.page(job_id, state="ready", limit=5)
    store.events.list(job_id, 3, 5)
    for text, given in list(statements):
        assert not _scanned(store, text, given) & {"tasks", "task_edges", "attempts", "events", "files"}, text


def _scanned(store: Store, text: str, given: object) -> set[str]:
    """Tables that SQLite would read from end to end for a statement."""
    if not store.database.is_sqlite or text.startswith(("BEGIN", "INSERT")):
        return set()
    with store.database.read() as connection:
        plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}", given).all()  # type: ignore[arg-type]
    return {row[3].split()[1] for row in plan if row[3].startswith("SCAN") and "INDEX" not in row[3]}


def test_totals_increase_with_every_counted_attempt(store: Store, clock: Clock) -> None:
    job_id = _job(store)
    _plan(store, Task("a", emits=(0, 8)))
    failing = _claim(store)
    clock.now += 2
    assert store.queue.finish(_answer(failing), machine.Failed(FAULT))
    assert not store.queue.finish(_answer(failing), machine.Failed(FAULT)), "a late answer is not counted"
    clock.now += 60
    claim = _claim(store)
    clock.now += 3
    quality = {"flicker": 0.5, "detail": 0.75, "structure": None, "pairs": 3}
    assert store.queue.finish(replace(_answer(claim), result={"quality": quality}))
    store.jobs.command(job_id, machine.Cancel())
    store.jobs.remove(job_id)
    assert store.statistics.snapshot()["totals"] == {
        "reports": {"flicker": {"toy": (1.0, 0.5)}, "detail": {"toy": (1.0, 0.75)}},
        "attempts": {"failed": 1, "succeeded": 1},
        "failures": {"internal-error": 1},
        "frames": {"toy": 8},
        "busy_s": {"toy": 5.0},
    }
