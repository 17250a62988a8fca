"""Workers, machines, drains and live sessions in the database; failures and timelines of jobs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import asdict
from typing import Any

from sqlalchemy import ColumnElement, Connection, Table, bindparam, delete, insert, or_, select, tuple_, update

from workers.contract.record import Page
from workers.contract.request import Json
from workers.errors import NotFound
from workers.operator_views import (
    AttemptLogView,
    Drain,
    DrainScope,
    Failure,
    LiveView,
    NodeView,
    RunningAttempt,
    Slot,
    TimelineBar,
    WorkerInfo,
    WorkerView,
)
from workers.store import schema, task_states
from workers.store.base import StorePart
from workers.store.job_transaction import RUNNING
from workers.store.records import AnySelect, Row, Values, pack_cursor, unpack_cursor

LIVE_KEPT_S = 30.0
"""A process that has not reported its live sessions for this long (seconds) counts as having none."""
_FAILED = ("failed", "interrupted")

Drained = dict[tuple[str, str], Drain]


class Workers(StorePart):
    """Every method is one transaction."""

    def now(self) -> float:
        """The clock of all these times."""
        return self._now()

    # -- workers

    def register(self, dispatcher: str, who: WorkerInfo, slots: Sequence[Slot]) -> None:
        """Register the worker and all its present slots. Does nothing if it has no lease."""
        table = schema.dispatchers
        with self._db.write() as connection:
            known = update(table).where(table.c.id == dispatcher).values(**asdict(who), seen_at=self._now())
            if connection.execute(known).rowcount:
                connection.execute(delete(schema.slots).where(schema.slots.c.dispatcher == dispatcher))
                rows = [{"dispatcher": dispatcher, **asdict(slot)} for slot in slots]
                _insert_all(connection, schema.slots, rows)

    def workers(self, cursor: str | None = None, limit: int = 50) -> Page:
        """`WorkerView` items, the longest-running first."""
        table = schema.dispatchers
        query = select(table).order_by(table.c.started_at, table.c.id).limit(limit + 1)
        if cursor is not None:
            query = query.where(tuple_(table.c.started_at, table.c.id) > tuple_(*unpack_cursor(cursor, float, str)))
        with self._db.read() as connection:
            rows = connection.execute(query).mappings().all()
            views = _worker_views(connection, rows[:limit], self._now())
        more = len(rows) > limit
        return Page(tuple(views), pack_cursor(views[-1].started_at, views[-1].id) if more else None)

    def nodes(self) -> list[NodeView]:
        """Nodes of workers that are not away, and drained nodes; by name."""
        with self._db.read() as connection:
            table = schema.dispatchers
            alive = connection.execute(select(table).where(table.c.lease_until >= self._now())).mappings().all()
            workers, drained = _worker_views(connection, alive, self._now()), _drained(connection)
        names = {slot.node for worker in workers for slot in worker.slots}
        names |= {name for place, name in drained if place == DrainScope.NODE}
        return [_node_view(name, workers, drained.get((DrainScope.NODE, name))) for name in sorted(names)]

    # -- drains

    def drains(self) -> list[Drain]:
        """All drains in force, that of the queue included."""
        with self._db.read() as connection:
            return list(_drained(connection).values())

    def drain(self, place: DrainScope, name: str = "", by: str = "", reason: str = "") -> Drain:
        """Drain a place: no further task starts there. A second call has no effect. Raises NotFound."""
        table = schema.drains
        with self._db.write() as connection:
            self._db.lock(connection, f"drain {place} {name}")
            _require_target(connection, place, name)
            known = _drained(connection).get((place, name))
            if known is None:
                known = Drain(place, name, self._now(), by[:80], reason)
                connection.execute(insert(table).values(asdict(known)))
        return known

    def resume(self, place: DrainScope, name: str = "") -> None:
        """Resume a drained place. A second call has no effect. Raises NotFound: there is no such place."""
        table = schema.drains
        with self._db.write() as connection:
            gone = delete(table).where(table.c.place == place, table.c.name == name)
            if not connection.execute(gone).rowcount:
                _require_target(connection, place, name)

    # -- what failed, what ran

    def failures(self, job_id: str | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        """`Failure` items, newest first."""
        attempts = schema.attempts
        query = _failed().order_by(attempts.c.finished_at.desc(), attempts.c.id.desc()).limit(limit + 1)
        if job_id is not None:
            query = query.where(attempts.c.job_id == job_id)
        if cursor is not None:
            query = query.where(_before((attempts.c.finished_at, attempts.c.id), unpack_cursor(cursor, float, str)))
        with self._db.read() as connection:
            rows = connection.execute(query).mappings().all()
        items = tuple(Failure(**row) for row in rows[:limit])
        last = items[-1] if len(rows) > limit else None
        return Page(items, None if last is None else pack_cursor(last.finished_at, last.attempt_id))

    def attempt_log(self, attempt_id: str) -> AttemptLogView:
        """Raises NotFound."""
        table = schema.attempts
        query = select(table).where(table.c.id == attempt_id)
        with self._db.read() as connection:
            row = connection.execute(query).mappings().first()
        if row is None:
            raise NotFound(f"There is no attempt {attempt_id}.", field="attempt_id", value=attempt_id)
        same = {name: row[name] for name in ("task_id", "job_id", "number", "outcome", "log")}
        return AttemptLogView(
            attempt_id=row["id"], worker=row["dispatcher"], slot=row["worker"], error=row["fault"], **same
        )

    def timeline(self, job_id: str, cursor: str | None = None, limit: int = 500) -> Page:
        """`TimelineBar` items, the latest begun first. Raises NotFound."""
        attempts = schema.attempts
        query = _bars(job_id).order_by(attempts.c.started_at.desc(), attempts.c.id.desc()).limit(limit + 1)
        if cursor is not None:
            query = query.where(_before((attempts.c.started_at, attempts.c.id), unpack_cursor(cursor, float, str)))
        with self._db.read() as connection:
            if connection.execute(select(schema.jobs.c.id).where(schema.jobs.c.id == job_id)).first() is None:
                raise NotFound(f"There is no job {job_id}.", field="job_id", value=job_id)
            rows = connection.execute(query).mappings().all()
        bars = tuple(_bar(row) for row in rows[:limit])
        more = len(rows) > limit
        return Page(bars, pack_cursor(bars[-1].started_at, bars[-1].attempt_id) if more else None)

    # -- live sessions

    def publish_live(self, process: str, sessions: Sequence[LiveView]) -> Collection[str]:
        """Replace the live sessions of `process` by these; returns the ids of those that an operator has ordered to
        end."""
        table, now = schema.live_sessions, self._now()
        with self._db.write() as connection:
            wanted = connection.execute(select(table.c.id).where(table.c.process == process, table.c.ending)).scalars()
            ending = set(wanted)
            mine_or_lost = or_(table.c.process == process, table.c.seen_at < now - LIVE_KEPT_S)
            connection.execute(delete(table).where(mine_or_lost))
            rows = [{**asdict(one), "process": process, "ending": one.id in ending, "seen_at": now} for one in sessions]
            _insert_all(connection, table, rows)
        return ending

    def live(self, cursor: str | None = None, limit: int = 50) -> Page:
        """`LiveView` items, oldest first; without those of processes that have been silent for long."""
        table = schema.live_sessions
        query = select(table).where(table.c.seen_at >= self._now() - LIVE_KEPT_S).order_by(table.c.id).limit(limit + 1)
        if cursor is not None:
            query = query.where(table.c.id > unpack_cursor(cursor, str)[0])
        with self._db.read() as connection:
            rows = connection.execute(query).mappings().all()
        items = tuple(_live_view(row) for row in rows[:limit])
        return Page(items, pack_cursor(items[-1].id) if len(rows) > limit else None)

    def end_live(self, session_id: str) -> None:
        """Order the session's process to end it, which takes seconds. Raises NotFound."""
        table = schema.live_sessions
        with self._db.write() as connection:
            if not connection.execute(update(table).where(table.c.id == session_id).values(ending=True)).rowcount:
                raise NotFound("Live session not found.", field="session_id", value=session_id)


def is_drained(connection: Connection, dispatcher: str) -> bool:
    """Whether this dispatcher may start nothing, because it is drained or the queue is paused."""
    return connection.execute(_DRAINED_OR_PAUSED, {"worker": dispatcher}).first() is not None


_DRAINED_OR_PAUSED = (
    select(schema.drains.c.place)
    .where(
        or_(
            schema.drains.c.place == DrainScope.QUEUE.value,
            (schema.drains.c.place == DrainScope.WORKER.value) & (schema.drains.c.name == bindparam("worker")),
        )
    )
    .limit(1)
)


_DRAINS = select(schema.drains).order_by(schema.drains.c.at)


def _require_target(connection: Connection, place: DrainScope, name: str) -> None:
    """Raise NotFound unless a place of that name exists."""
    workers, slots = schema.dispatchers, schema.slots
    if place is DrainScope.QUEUE:
        return
    query = select(workers.c.id).where(workers.c.id == name)
    if place is DrainScope.NODE:
        query = select(slots.c.name).where(slots.c.node == name).limit(1)
    if connection.execute(query).first() is None:
        raise NotFound(f"There is no {place} {name}.", field=place.value, value=name, remedy=f"See /v1/ops/{place}s.")


def _drained(connection: Connection) -> Drained:
    found = connection.execute(_DRAINS).mappings()
    return {(row["place"], row["name"]): Drain(**{**row, "place": DrainScope(row["place"])}) for row in found}


# -- workers and nodes


def _worker_views(connection: Connection, rows: Sequence[Row], now: float) -> list[WorkerView]:
    ids = [row["id"] for row in rows]
    slots, drained = _slots(connection, ids), _drained(connection)
    nodes = {(worker, slot.name): slot.node for worker, mine in slots.items() for slot in mine}
    at_work = _at_work(connection, ids, nodes)
    return [
        _worker_view(row, slots[row["id"]], at_work[row["id"]], drained.get((DrainScope.WORKER, row["id"])), now)
        for row in rows
    ]


def _worker_view(
    row: Row, slots: list[Slot], at_work: list[RunningAttempt], drain: Drain | None, now: float
) -> WorkerView:
    same = {name: row[name] for name in ("id", "host", "role", "kind", "version", "started_at")}
    seen_at = max(row["seen_at"], row["started_at"])
    state = "draining" if at_work else "drained"
    if row["lease_until"] < now:
        state = "away"
    elif drain is None:
        state = "live"
    return WorkerView(state=state, seen_at=seen_at, slots=tuple(slots), at_work=tuple(at_work), drain=drain, **same)


def _node_view(name: str, workers: Sequence[WorkerView], drain: Drain | None) -> NodeView:
    here = [slot for worker in workers for slot in worker.slots if slot.node == name]
    busy = sum(1 for worker in workers for work in worker.at_work if work.node == name)
    state = "open" if drain is None else "draining" if busy else "drained"
    return NodeView(
        name=name,
        state=state,
        slots=len(here),
        busy=busy,
        cpus=sum(slot.cpus for slot in here),
        gpus=sum(slot.gpus for slot in here),
        memory_bytes=sum(slot.memory_bytes for slot in here),
        workers=tuple(worker.id for worker in workers if any(slot.node == name for slot in worker.slots)),
        drain=drain,
    )


def _slots(connection: Connection, ids: Sequence[str]) -> dict[str, list[Slot]]:
    table = schema.slots
    found: dict[str, list[Slot]] = defaultdict(list)
    for row in connection.execute(select(table).where(table.c.dispatcher.in_(ids)).order_by(table.c.name)).mappings():
        found[row["dispatcher"]].append(Slot(**{name: row[name] for name in Slot.__dataclass_fields__}))
    return found


def _at_work(
    connection: Connection, ids: Sequence[str], nodes: dict[tuple[str, str], str]
) -> dict[str, list[RunningAttempt]]:
    attempts, tasks, jobs, steps = schema.attempts, schema.tasks, schema.jobs, schema.steps
    query = (
        select(
            attempts.c.id.label("attempt_id"), attempts.c.task_id, attempts.c.job_id, jobs.c.method,
            steps.c.name.label("step"), tasks.c.key, attempts.c.number, tasks.c.progress, attempts.c.started_at,
            attempts.c.worker.label("slot"), attempts.c.dispatcher,
        )
        .join(tasks, tasks.c.id == attempts.c.task_id)
        .join(jobs, jobs.c.id == attempts.c.job_id)
        .join(steps, (steps.c.job_id == tasks.c.job_id) & (steps.c.step == tasks.c.step))
        .where(attempts.c.outcome == RUNNING, attempts.c.dispatcher.in_(ids))
        .order_by(attempts.c.id)
    )  # fmt: skip
    found: dict[str, list[RunningAttempt]] = defaultdict(list)
    for row in connection.execute(query).mappings():
        values: Json = dict(row)
        worker = values.pop("dispatcher")
        found[worker].append(RunningAttempt(**values, node=nodes.get((worker, values["slot"]), "")))
    return found


# -- failures and timelines


def _failed() -> AnySelect:
    attempts, tasks, jobs, steps = schema.attempts, schema.tasks, schema.jobs, schema.steps
    return (
        select(
            attempts.c.id.label("attempt_id"), attempts.c.task_id, attempts.c.job_id,
            jobs.c.request["name"].as_string().label("job_name"), jobs.c.state.label("job_state"), jobs.c.owner,
            jobs.c.method, steps.c.name.label("step"), tasks.c.key,
            task_states.of_task(jobs.c.state).label("task_state"),
            attempts.c.number, attempts.c.outcome, attempts.c.dispatcher.label("worker"),
            attempts.c.worker.label("slot"), attempts.c.started_at, attempts.c.finished_at,
            attempts.c.fault.label("error"),
        )
        .join(tasks, tasks.c.id == attempts.c.task_id)
        .join(jobs, jobs.c.id == attempts.c.job_id)
        .join(steps, (steps.c.job_id == tasks.c.job_id) & (steps.c.step == tasks.c.step))
        .where(attempts.c.outcome.in_(_FAILED))
    )  # fmt: skip


def _bars(job_id: str) -> AnySelect:
    attempts, tasks, steps = schema.attempts, schema.tasks, schema.steps
    return (
        select(
            attempts.c.id.label("attempt_id"), attempts.c.task_id, steps.c.name.label("step"), tasks.c.key,
            attempts.c.number, attempts.c.dispatcher.label("worker"), attempts.c.worker.label("slot"),
            attempts.c.outcome, attempts.c.started_at, attempts.c.finished_at, attempts.c.fault,
        )
        .join(tasks, tasks.c.id == attempts.c.task_id)
        .join(steps, (steps.c.job_id == tasks.c.job_id) & (steps.c.step == tasks.c.step))
        .where(attempts.c.job_id == job_id)
    )  # fmt: skip


def _bar(row: Row) -> TimelineBar:
    values = dict(row)
    return TimelineBar(code=(values.pop("fault") or {}).get("code", ""), **values)


def _live_view(row: Row) -> LiveView:
    return LiveView(**{name: row[name] for name in LiveView.__dataclass_fields__})


def _before(columns: Sequence[ColumnElement[Any]], values: Sequence[object]) -> ColumnElement[bool]:
    """Condition: rows after these values in a descending listing."""
    return tuple_(*columns) < tuple_(*values)


def _insert_all(connection: Connection, table: Table, rows: list[Values]) -> None:
    if rows:
        connection.execute(insert(table), rows)
