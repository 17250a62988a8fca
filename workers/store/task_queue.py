"""Operations of dispatchers on tasks: claims, leases, outcomes. Outcomes are fenced by attempt id."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from sqlalchemy import Connection, RowMapping, bindparam, delete, func, insert, or_, select, update

from pipeline.errors import StorageError
from workers.contract.order import PEAK_MEMORY, TaskOutcome
from workers.contract.record import TaskState
from workers.jobs import state_machine as machine
from workers.jobs.state_machine import StateEvent
from workers.operator_views import DrainScope
from workers.process.log_context import log_extra
from workers.store import fair_scheduler, schema
from workers.store.base import Clock, StorePart
from workers.store.claims import Claim, ClaimFailed, OtherVersion, claim_in
from workers.store.counters import AttemptCounters
from workers.store.database import Database
from workers.store.event_notifier import EventNotifier
from workers.store.fair_scheduler import Lane
from workers.store.job_transaction import RUNNING, JobTransaction, StorePolicy
from workers.store.job_views import meters_of
from workers.store.progress import job_eta_s, job_progress, recent_pace_s
from workers.store.records import Row, TaskRow, emitted_run, fault_to_json
from workers.store.workers import is_drained

log = logging.getLogger(__name__)

_CLAIM_TRIES = 8
"""Number of tries of a claim when other dispatchers take the tasks first."""
_FORGOTTEN_S = 3600.0
_LOG_KEPT = 64 << 10
"""Maximum number of characters of an attempt's log; the last ones are kept."""


@dataclass(frozen=True)
class Heartbeat:
    """Progress of a running attempt."""

    done: float
    """0..1"""
    worker: str = ""
    preview: str = ""
    """Blob key of its newest frame, JPEG; empty: none."""


class TaskQueue(StorePart):
    """The store as dispatchers see it. Every method is one transaction."""

    def __init__(
        self, db: Database, notifier: EventNotifier, policy: StorePolicy, now: Clock, counters: AttemptCounters
    ) -> None:
        super().__init__(db, notifier, policy, now)
        self._counters = counters
        self._known_dispatchers: set[str] = set()
        """Dispatchers that this process has given a lease."""

    # -- claiming

    def claim(
        self, dispatcher: str, lease_s: float, skipped: Collection[str] = (),
        readable: Callable[[Row], bool] = lambda job: True,
    ) -> Claim | None:  # fmt: skip
        """Claim the next task; None if no task may run now. See `fair_scheduler` for the order.

        Args:
            skipped: ids of jobs that are passed over.
            readable: whether this program can continue the job, of which the row is given.

        Raises:
            OtherVersion: the next job is not readable.
            ClaimFailed: an unexpected error prevented claiming a task of the next job.
        """
        for _ in range(_CLAIM_TRIES):
            row: RowMapping | None = None
            try:
                with self._db.write() as connection:
                    self._add_dispatcher(connection, dispatcher, lease_s)
                    lanes = self._lanes(connection, dispatcher)
                    row = self._next_job(connection, lanes, skipped)
                    if row is None:
                        return None
                    if not readable(row):
                        raise OtherVersion(row["id"])
                    job = JobTransaction(connection, row, self._now(), self._policy)
                    claim = claim_in(job, dispatcher)
                    if claim is not None:
                        job.take_turn(min(lane.used_s for lane in lanes))
                    job.close()
            except (StorageError, OtherVersion):
                raise
            except Exception as error:
                if row is None:
                    raise
                raise ClaimFailed(row["id"]) from error
            if claim is not None:
                self._notifier.notify(claim.job_id, job.seq)
                return claim
        return None

    def _lanes(self, connection: Connection, dispatcher: str) -> list[Lane]:
        """Lanes from which this dispatcher may claim."""
        return [] if is_drained(connection, dispatcher) else fair_scheduler.lanes(connection, self._policy.owner_tasks)

    def _next_job(self, connection: Connection, lanes: Sequence[Lane], skipped: Collection[str]) -> RowMapping | None:
        """A job with a ready task, locked. It waits for a job that another dispatcher has locked only if there is no
        other, so that two dispatchers can both work on a single job."""
        for wait in (False,) if self._db.is_sqlite else (False, True):
            for lane in lanes:
                if (row := fair_scheduler.job_in(connection, lane, self._now(), wait, skipped)) is not None:
                    return row
        return None

    # -- while it runs

    def renew(self, dispatcher: str, lease_s: float) -> None:
        """Extend the dispatcher's lease to `lease_s` from now."""
        with self._db.write() as connection:
            self._renew(connection, dispatcher, lease_s)

    def _renew(self, connection: Connection, dispatcher: str, lease_s: float) -> None:
        table, now = schema.dispatchers, self._now()
        lease = {"lease_until": now + lease_s, "seen_at": now}
        if not connection.execute(update(table).where(table.c.id == dispatcher).values(lease)).rowcount:
            connection.execute(insert(table).values(id=dispatcher, started_at=now, **lease))
        self._known_dispatchers.add(dispatcher)

    def _add_dispatcher(self, connection: Connection, dispatcher: str, lease_s: float) -> None:
        """Give the dispatcher a lease, which it needs before it claims."""
        if dispatcher not in self._known_dispatchers:
            self._renew(connection, dispatcher, lease_s)

    def retire(self, dispatcher: str) -> None:
        """End the dispatcher's lease: others return its remaining attempts to the queue at once."""
        with self._db.write() as connection:
            connection.execute(delete(schema.dispatchers).where(schema.dispatchers.c.id == dispatcher))
            _forget_drains(connection)
        self._known_dispatchers.discard(dispatcher)

    def dispatchers(self) -> list[str]:
        """Live dispatchers, the longest-running first."""
        table = schema.dispatchers
        query = select(table.c.id).where(table.c.lease_until >= self._now()).order_by(table.c.started_at, table.c.id)
        with self._db.read() as connection:
            return list(connection.execute(query).scalars())

    def attempts_of(self, dispatcher: str) -> set[str]:
        """The dispatcher's attempts that still count."""
        with self._db.read() as connection:
            return set(connection.execute(_ATTEMPTS_OF, {"dispatcher": dispatcher}).scalars())

    def progress(self, heartbeats: Mapping[str, Heartbeat]) -> None:
        """Record progress, worker and preview of attempts, by id; attempts that no longer count are skipped."""
        with self._db.read() as connection:
            rows = connection.execute(_STILL_RUNNING, {"ids": list(heartbeats)}).all()
        for job_id in {row.job_id for row in rows}:
            self._progress_in(job_id, {row.id: heartbeats[row.id] for row in rows if row.job_id == job_id})

    def _progress_in(self, job_id: str, heartbeats: Mapping[str, Heartbeat]) -> None:
        with self._transaction_if_any(job_id) as job:
            current = [] if job is None else [_find_current(job, attempt_id) for attempt_id in heartbeats]
            for each in filter(None, current):
                _record_heartbeat(each, heartbeats[each.attempt["id"]])
            if job is not None and any(current):
                _add_progress_event(job)

    # -- outcomes

    def finish(self, outcome: TaskOutcome, event: StateEvent | None = None, worker: str = "") -> bool:
        """Record an attempt's outcome, once; False if the attempt no longer counts (then nothing has changed).

        Args:
            outcome: the attempt's result; its log and fault are kept even if it failed.
            event: what happened; None: success.
            worker: name of the worker that ran it.
        """
        with self._current_attempt(outcome.attempt_id) as current:
            if current is None:
                return False
            if event is None:
                _keep_result(current, outcome)
                event = machine.Done(_frees(current.job.connection, current.task["id"]))
            _end(current, event, outcome, worker)
        self._count(current, event)
        if isinstance(event, machine.Done) and isinstance(quality := outcome.result.get("quality"), dict):
            self._counters.reported(current.job.row["method"], quality)
        return True

    def _count(self, current: _CurrentAttempt, event: StateEvent) -> None:
        code = event.fault.code if isinstance(event, machine.Failed) else ""
        task, seconds = current.task, self._now() - current.attempt["started_at"]
        start, stop = (emitted_run(task) if isinstance(event, machine.Done) else None) or (0, 0)
        self._counters.ended(_OUTCOMES[type(event)], code, current.job.row["method"], stop - start, seconds)

    def interrupt(self, dispatchers: Collection[str]) -> int:
        """Return the attempts of dead dispatchers, and of those whose lease has expired, to the queue; returns their
        number."""
        table, leases, now = schema.attempts, schema.dispatchers, self._now()
        alive = select(leases.c.id).where(leases.c.lease_until >= now, leases.c.id.not_in(dispatchers))
        query = select(table.c.id).where(table.c.outcome == RUNNING, table.c.dispatcher.not_in(alive))
        with self._db.read() as connection:
            ids = connection.execute(query).scalars().all()
        log = "The process that ran this attempt has died or was cut off."
        given_back = sum(self._interrupt_one(TaskOutcome(i, {}, {}, {}, None, {}, log)) for i in ids)
        with self._db.write() as connection:
            gone = or_(leases.c.id.in_(dispatchers), leases.c.lease_until < now - _FORGOTTEN_S)
            if connection.execute(delete(leases).where(gone)).rowcount:
                _forget_drains(connection)
        return given_back

    def _interrupt_one(self, outcome: TaskOutcome) -> bool:
        """Release the attempts; an attempt that cannot be released does not keep the others from it."""
        try:
            return self.finish(outcome, machine.Interrupted())
        except StorageError:
            raise
        except Exception:
            log.exception("the attempt cannot be returned to the queue", extra=log_extra(attempt=outcome.attempt_id))
            return False

    def postpone(self, attempt_id: str, seconds: float, log: str) -> bool:
        """Return an attempt to the queue without counting a failure; it can be claimed after `seconds` (storage was
        unreachable)."""
        with self._current_attempt(attempt_id) as current:
            if current is None:
                return False
            _end(current, machine.Released(), TaskOutcome(attempt_id, {}, {}, {}, None, {}, log))
            current.job.delay(current.task, seconds)
        self._count(current, machine.Released())
        return True

    # -- fences

    @contextmanager
    def _current_attempt(self, attempt_id: str) -> Iterator[_CurrentAttempt | None]:
        """The attempt with its task and job, if it counts: it is running, and the task's current attempt."""
        with self._db.read() as connection:
            job_id = connection.execute(_JOB_OF, {"id": attempt_id}).scalar()
        if job_id is None:
            yield None
            return
        with self._transaction_if_any(job_id) as job:
            yield None if job is None else _find_current(job, attempt_id)


@dataclass(frozen=True)
class _CurrentAttempt:
    """A running attempt under the lock of its job."""

    job: JobTransaction
    task: TaskRow
    attempt: Row


def _find_current(job: JobTransaction, attempt_id: str) -> _CurrentAttempt | None:
    attempt = job.connection.execute(_ATTEMPT, {"id": attempt_id}).mappings().first()
    if attempt is None or attempt["outcome"] != RUNNING:
        return None
    task = job.task(attempt["task_id"])
    if task["attempt_id"] != attempt_id or task["state"] != TaskState.RUNNING.value:
        return None
    return _CurrentAttempt(job, task, dict(attempt))


def _forget_drains(connection: Connection) -> None:
    """Delete drains of workers that no longer exist. Drains of nodes stay, since the machine may come back."""
    drains, workers = schema.drains, schema.dispatchers
    gone = (drains.c.place == DrainScope.WORKER.value, drains.c.name.not_in(select(workers.c.id)))
    connection.execute(delete(drains).where(*gone))


# Built once, because building a statement takes longer than running it.
_ATTEMPT = select(schema.attempts).where(schema.attempts.c.id == bindparam("id"))
_ATTEMPTS_OF = select(schema.attempts.c.id).where(
    schema.attempts.c.dispatcher == bindparam("dispatcher"), schema.attempts.c.outcome == RUNNING
)
_STILL_RUNNING = select(schema.attempts.c.id, schema.attempts.c.job_id).where(
    schema.attempts.c.id.in_(bindparam("ids", expanding=True)), schema.attempts.c.outcome == RUNNING
)
_SET_PROGRESS = update(schema.tasks).where(schema.tasks.c.id == bindparam("task_id")).values(progress=bindparam("done"))
_SET_WORKER = (
    update(schema.attempts).where(schema.attempts.c.id == bindparam("attempt_id")).values(worker=bindparam("by"))
)
_JOB_OF = select(schema.attempts.c.job_id).where(schema.attempts.c.id == bindparam("id"))
_FREES = (
    select(func.count())
    .select_from(schema.task_edges.join(schema.tasks, schema.tasks.c.id == schema.task_edges.c.task_id))
    .where(
        schema.task_edges.c.before_id == bindparam("task_id"),
        schema.tasks.c.blockers == 1,
        schema.tasks.c.state == TaskState.WAITING.value,
    )
)
"""Number of tasks that wait for this one only."""


# -- while it runs


def _record_heartbeat(current: _CurrentAttempt, heartbeat: Heartbeat) -> None:
    connection = current.job.connection
    connection.execute(_SET_PROGRESS, {"task_id": current.task["id"], "done": heartbeat.done})
    if heartbeat.worker != current.attempt["worker"]:
        connection.execute(_SET_WORKER, {"attempt_id": current.attempt["id"], "by": heartbeat.worker})
    if heartbeat.preview:
        _keep_file(current.job, "preview", heartbeat.preview, "image/jpeg")


# -- outcomes


def _keep_result(current: _CurrentAttempt, outcome: TaskOutcome) -> None:
    """Store the outcome of a successful attempt: result, artefacts, segment, files and times."""
    job, task = current.job, current.task
    made = {"result": outcome.result, "artefacts": outcome.artefacts, "segment": outcome.segment,
            "trace": None if job.row["base_id"] is None else outcome.trace, "reused": outcome.reused}  # fmt: skip
    job.connection.execute(update(schema.tasks).where(schema.tasks.c.id == task["id"]).values(made))
    for name, (key, media_type) in outcome.files.items():
        _keep_file(job, name, key, media_type)
    _add_measures(job, task, outcome, job.now - current.attempt["started_at"])
    job.add_warnings(outcome.warnings)


def _keep_file(job: JobTransaction, name: str, key: str, media_type: str) -> None:
    """Set the blob of the job's file with this name."""
    files = schema.files
    row = {"key": key, "media_type": media_type, "created_at": job.now}
    known = update(files).where(files.c.job_id == job.job_id, files.c.name == name).values(row)
    if not job.connection.execute(known).rowcount:
        job.connection.execute(insert(files).values(job_id=job.job_id, name=name, **row))


def _add_measures(job: JobTransaction, task: TaskRow, outcome: TaskOutcome, seconds: float) -> None:
    steps = schema.steps
    step, stages = job.step_row(task["step"]), outcome.stages
    before = step["stages"]
    summed = {name: before.get(name, 0.0) + stages.get(name, 0.0) for name in {*before, *stages}}
    if PEAK_MEMORY in summed:
        summed[PEAK_MEMORY] = max(before.get(PEAK_MEMORY, 0.0), stages.get(PEAK_MEMORY, 0.0))
    values = {"stages": summed, "busy_s": step["busy_s"] + seconds, "weight_done": step["weight_done"] + task["weight"],
              "reused": step["reused"] + outcome.reused,
              "pace_s": recent_pace_s(step["pace_s"], seconds, task["weight"])}  # fmt: skip
    where = (steps.c.job_id == job.job_id, steps.c.step == task["step"])
    job.connection.execute(update(steps).where(*where).values(values))


def _frees(connection: Connection, task_id: str) -> int:
    """Number of tasks that wait for this one only."""
    return int(connection.execute(_FREES, {"task_id": task_id}).scalar_one())


def _end(current: _CurrentAttempt, event: StateEvent, outcome: TaskOutcome, worker: str = "") -> None:
    """Close the attempt, apply the event to the state machine, and add an event to the history."""
    job, task, attempt = current.job, current.task, current.attempt
    fault = event.fault if isinstance(event, machine.Failed) else None
    ended = {
        "outcome": _OUTCOMES[type(event)],
        "finished_at": job.now,
        "fault": fault_to_json(fault),
        "log": _storable(outcome.log[-_LOG_KEPT:]),
        "worker": worker or attempt["worker"],
    }
    job.connection.execute(update(schema.attempts).where(schema.attempts.c.id == attempt["id"]).values(ended))
    job.charge(job.now - attempt["started_at"])
    after = job.apply(event, task).task
    state = TaskState.READY if after is None else after.state
    job.add_task_event(task, state, attempt=attempt["number"], outcome=ended["outcome"], error=ended["fault"])


def _storable(log: str) -> str:
    """The log without characters that a database refuses, which decoders and drivers may print; they are replaced."""
    return log.replace("\0", "\N{REPLACEMENT CHARACTER}").encode("utf-8", "replace").decode()


_OUTCOMES: dict[type, str] = {
    machine.Done: "succeeded",
    machine.Failed: "failed",
    machine.Interrupted: "interrupted",
    machine.Released: "released",
}


def _add_progress_event(job: JobTransaction) -> None:
    meters = meters_of(job.connection, job.row, job.now)
    step = job.step_row(job.row["step"])["name"]
    job.add_event("job.progress", {"progress": job_progress(meters), "eta_s": job_eta_s(meters), "step": step})
