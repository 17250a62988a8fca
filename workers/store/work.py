"""What dispatchers do with tasks: claim them, keep leases, bring in outcomes. Answers are fenced by attempt id."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Select, and_, exists, func, insert, or_, select, update

from workers import jobs as machine
from workers.ids import new_id
from workers.jobs import Happening
from workers.model import TaskOutcome, TaskState
from workers.progress import job_eta_s, job_progress
from workers.store import schema
from workers.store.base import Base, Bell, Clock
from workers.store.book import ACTIVE, RUNNING, JobBook, Policy
from workers.store.database import Database
from workers.store.records import fault_to_json
from workers.store.tally import Tally
from workers.store.views import meters_of

_LOG_KEPT = 64 << 10
"""Characters of an attempt's log that are kept: the last ones."""


@dataclass(frozen=True)
class Claim:
    """A task that this dispatcher runs now."""

    attempt_id: str
    job_id: str
    step_name: str
    task: Mapping[str, Any]
    """The row of the task."""
    job: Mapping[str, Any]
    """The row of its job."""


@dataclass(frozen=True)
class Sign:
    """A sign of life of a running attempt."""

    done: float
    """0..1"""
    worker: str = ""
    preview: str = ""
    """Blob key of its newest frame, JPEG; empty: none."""


class Work(Base):
    """The store as dispatchers see it. Every method is one transaction."""

    def __init__(self, db: Database, bell: Bell, policy: Policy, now: Clock, tally: Tally) -> None:
        super().__init__(db, bell, policy, now)
        self._tally = tally

    # -- claiming

    def claim(self, dispatcher: str, lease_s: float) -> Claim | None:
        """The next task to run: highest priority, then the owner, then the job with the least running, then oldest."""
        with self._db.write() as connection:
            job_id = connection.execute(_claimable(self._now())).scalar()
            if job_id is None:
                return None
            book = JobBook.open(connection, job_id, self._now(), self._policy)
            if book is None:
                return None
            claim = _claim_in(book, dispatcher, self._now() + lease_s)
            book.close()
        self._bell.ring(job_id, book.seq)
        return claim

    # -- while it runs

    def renew(self, dispatcher: str, lease_s: float) -> set[str]:
        """Prolong the leases of a dispatcher's attempts; which still count (others were taken away)."""
        table = schema.attempts
        mine = (table.c.dispatcher == dispatcher, table.c.outcome == RUNNING)
        with self._db.write() as connection:
            connection.execute(update(table).where(*mine).values(lease_until=self._now() + lease_s))
            return set(connection.execute(select(table.c.id).where(*mine)).scalars())

    def mine(self, dispatcher: str) -> set[str]:
        """The dispatcher's attempts that still count."""
        table = schema.attempts
        query = select(table.c.id).where(table.c.dispatcher == dispatcher, table.c.outcome == RUNNING)
        with self._db.read() as connection:
            return set(connection.execute(query).scalars())

    def progress(self, signs: Mapping[str, Sign]) -> None:
        """Note how far attempts are (by id), where, and what there is to see; skips those that no longer count."""
        table = schema.attempts
        query = select(table.c.id, table.c.job_id).where(table.c.id.in_(signs), table.c.outcome == RUNNING)
        with self._db.read() as connection:
            rows = connection.execute(query).all()
        for job_id in {row.job_id for row in rows}:
            self._progress_in(job_id, {row.id: signs[row.id] for row in rows if row.job_id == job_id})

    def _progress_in(self, job_id: str, signs: Mapping[str, Sign]) -> None:
        with self._book_if_any(job_id) as book:
            held = [] if book is None else [_current(book, attempt_id) for attempt_id in signs]
            for each in filter(None, held):
                _note_sign(each, signs[each.attempt["id"]])
            if book is not None and any(held):
                _say_progress(book)

    # -- outcomes

    def finish(self, outcome: TaskOutcome, event: Happening | None = None, worker: str = "") -> bool:
        """Bring in an attempt's outcome, once; False if the attempt no longer counts (nothing has changed then).

        Args:
            outcome: what the attempt brought back; its log and fault are kept even if it failed.
            event: what happened, if not what `outcome` says by itself (success).
            worker: who ran it.
        """
        with self._held(outcome.attempt_id) as held:
            if held is None:
                return False
            if event is None:
                _keep_result(held, outcome)
                event = machine.Done(_frees(held.book.connection, held.task["id"]))
            _end(held, event, outcome, worker)
        self._count(held, event)
        return True

    def _count(self, held: _Held, event: Happening) -> None:
        code = event.fault.code if isinstance(event, machine.Failed) else ""
        task, seconds = held.task, self._now() - held.attempt["started_at"]
        emitted = isinstance(event, machine.Done) and task["emit_start"] is not None
        frames = task["emit_stop"] - task["emit_start"] if emitted else 0
        self._tally.ended(_OUTCOMES[type(event)], code, held.book.row["method"], frames, seconds)

    def interrupt(self, dispatchers: Collection[str]) -> int:
        """Give back what dispatchers that are dead, or silent beyond their lease, were running; say how much."""
        table = schema.attempts
        dead = or_(table.c.dispatcher.in_(dispatchers), table.c.lease_until < self._now())
        with self._db.read() as connection:
            ids = connection.execute(select(table.c.id).where(table.c.outcome == RUNNING, dead)).scalars().all()
        log = "The process that ran this attempt has died or was cut off."
        return sum(self.finish(TaskOutcome(i, {}, {}, {}, None, {}, log), machine.Interrupted()) for i in ids)

    def put_off(self, attempt_id: str, seconds: float, log: str) -> bool:
        """Give an attempt back without blame, to be claimed again in a while (storage was away)."""
        with self._held(attempt_id) as held:
            if held is None:
                return False
            _end(held, machine.Released(), TaskOutcome(attempt_id, {}, {}, {}, None, {}, log))
            held.book.delay(held.task, seconds)
        self._count(held, machine.Released())
        return True

    # -- fences

    @contextmanager
    def _held(self, attempt_id: str) -> Iterator[_Held | None]:
        """The attempt with its task and job, if it is the task's current one and running: only then it counts."""
        with self._db.read() as connection:
            attempts = schema.attempts
            job_id = connection.execute(select(attempts.c.job_id).where(attempts.c.id == attempt_id)).scalar()
        if job_id is None:
            yield None
            return
        with self._book_if_any(job_id) as book:
            yield None if book is None else _current(book, attempt_id)


@dataclass(frozen=True)
class _Held:
    """A running attempt under the lock of its job."""

    book: JobBook
    task: dict[str, Any]
    attempt: dict[str, Any]


def _current(book: JobBook, attempt_id: str) -> _Held | None:
    table = schema.attempts
    attempt = book.connection.execute(select(table).where(table.c.id == attempt_id)).mappings().first()
    if attempt is None or attempt["outcome"] != RUNNING:
        return None
    task = book.task(attempt["task_id"])
    if task["attempt_id"] != attempt_id or task["state"] != TaskState.RUNNING.value:
        return None
    return _Held(book, task, dict(attempt))


# -- claiming


def _claimable(now: float) -> Select[str]:
    """Id of the job that is served next.

    A job that another dispatcher has under lock at this moment is passed over, where the database can.
    """
    jobs, steps, tasks = schema.jobs, schema.steps, schema.tasks
    current = and_(steps.c.job_id == jobs.c.id, steps.c.step == jobs.c.step)
    loads = (
        select(jobs.c.owner, func.sum(steps.c.running).label("running"))
        .join(steps, current)
        .where(jobs.c.state.in_(ACTIVE))
        .group_by(jobs.c.owner)
        .subquery()
    )
    ready = exists().where(tasks.c.job_id == jobs.c.id, tasks.c.state == TaskState.READY.value, tasks.c.ready_at <= now)
    return (
        select(jobs.c.id)
        .join(steps, current)
        .join(loads, loads.c.owner == jobs.c.owner)
        .where(jobs.c.state.in_(ACTIVE), jobs.c.planned, ~jobs.c.doomed, steps.c.ready > 0, ready)
        .order_by(jobs.c.priority.desc(), loads.c.running, steps.c.running, jobs.c.id)
        .limit(1)
        .with_for_update(of=jobs, skip_locked=True)
    )


def _claim_in(book: JobBook, dispatcher: str, lease_until: float) -> Claim | None:
    """Claim the job's first ready task, if it still has one now that the job is under lock."""
    task = _first_ready(book)
    if task is None or book.row["doomed"] or book.row["state"] not in ACTIVE:
        return None
    book.happen(machine.Claimed(), task)
    attempt_id, number = new_id("att_"), _next_number(book.connection, task["id"])
    attempt = {"id": attempt_id, "task_id": task["id"], "job_id": book.job_id, "number": number, "outcome": RUNNING}
    attempt |= {"dispatcher": dispatcher, "started_at": book.now, "lease_until": lease_until}
    book.connection.execute(insert(schema.attempts).values(attempt))
    where = schema.tasks.c.id == task["id"]
    book.connection.execute(update(schema.tasks).where(where).values(attempt_id=attempt_id))
    task["attempt_id"] = attempt_id
    book.say_task(task, TaskState.RUNNING, attempt=number)
    return Claim(attempt_id, book.job_id, book.step_row(task["step"])["name"], task, book.row)


def _first_ready(book: JobBook) -> dict[str, Any] | None:
    tasks = schema.tasks
    query = (
        select(tasks)
        .where(tasks.c.job_id == book.job_id, tasks.c.state == TaskState.READY.value, tasks.c.ready_at <= book.now)
        .order_by(tasks.c.position)
        .limit(1)
        .with_for_update(skip_locked=True)
    )
    row = book.connection.execute(query).mappings().first()
    return None if row is None else dict(row)


def _next_number(connection: Connection, task_id: str) -> int:
    table = schema.attempts
    made = select(func.coalesce(func.max(table.c.number), 0)).where(table.c.task_id == task_id)
    return int(connection.execute(made).scalar_one()) + 1


# -- while it runs


def _note_sign(held: _Held, sign: Sign) -> None:
    tasks, attempts, connection = schema.tasks, schema.attempts, held.book.connection
    connection.execute(update(tasks).where(tasks.c.id == held.task["id"]).values(progress=sign.done))
    connection.execute(update(attempts).where(attempts.c.id == held.attempt["id"]).values(worker=sign.worker))
    if sign.preview:
        _keep_file(held.book, "preview", sign.preview, "image/jpeg")


# -- outcomes


def _keep_result(held: _Held, outcome: TaskOutcome) -> None:
    """Write what a successful attempt made: note, artefacts, segment, files, and its seconds."""
    book, task = held.book, held.task
    made = {"note": outcome.note, "artefacts": outcome.artefacts, "segment": outcome.segment}
    book.connection.execute(update(schema.tasks).where(schema.tasks.c.id == task["id"]).values(made))
    for name, (key, media_type) in outcome.files.items():
        _keep_file(book, name, key, media_type)
    _add_measures(book, task, outcome.stages, book.now - held.attempt["started_at"])


def _keep_file(book: JobBook, name: str, key: str, media_type: str) -> None:
    """The job's file of this name is this blob from now on."""
    files = schema.files
    row = {"key": key, "media_type": media_type, "created_at": book.now}
    known = update(files).where(files.c.job_id == book.job_id, files.c.name == name).values(row)
    if not book.connection.execute(known).rowcount:
        book.connection.execute(insert(files).values(job_id=book.job_id, name=name, **row))


def _add_measures(book: JobBook, task: dict[str, Any], stages: Mapping[str, float], seconds: float) -> None:
    steps = schema.steps
    step = book.step_row(task["step"])
    summed = {name: step["stages"].get(name, 0.0) + stages.get(name, 0.0) for name in {*step["stages"], *stages}}
    values = {"stages": summed, "busy_s": step["busy_s"] + seconds, "weight_done": step["weight_done"] + task["weight"]}
    where = (steps.c.job_id == book.job_id, steps.c.step == task["step"])
    book.connection.execute(update(steps).where(*where).values(values))


def _frees(connection: Connection, task_id: str) -> int:
    """How many tasks wait for this one only."""
    tasks, edges = schema.tasks, schema.task_edges
    query = (
        select(func.count())
        .select_from(edges.join(tasks, tasks.c.id == edges.c.task_id))
        .where(edges.c.before_id == task_id, tasks.c.blockers == 1, tasks.c.state == TaskState.WAITING.value)
    )
    return int(connection.execute(query).scalar_one())


def _end(held: _Held, event: Happening, outcome: TaskOutcome, worker: str = "") -> None:
    """Close the attempt, let the machine decide what follows, and say it."""
    book, task, attempt = held.book, held.task, held.attempt
    fault = event.fault if isinstance(event, machine.Failed) else None
    ended = {
        "outcome": _OUTCOMES[type(event)],
        "finished_at": book.now,
        "fault": fault_to_json(fault),
        "log": outcome.log[-_LOG_KEPT:],
        "worker": worker or attempt["worker"],
    }
    book.connection.execute(update(schema.attempts).where(schema.attempts.c.id == attempt["id"]).values(ended))
    after = book.happen(event, task).task
    state = TaskState.READY if after is None else after.state
    book.say_task(task, state, attempt=attempt["number"], outcome=ended["outcome"], error=ended["fault"])


_OUTCOMES: dict[type, str] = {
    machine.Done: "succeeded",
    machine.Failed: "failed",
    machine.Interrupted: "interrupted",
    machine.Released: "released",
}


def _say_progress(book: JobBook) -> None:
    meters = meters_of(book.connection, book.row, book.now)
    step = book.step_row(book.row["step"])["name"]
    book.say("job.progress", {"progress": job_progress(meters), "eta_s": job_eta_s(meters), "step": step})
