"""Statistics for operators: queue depth, running attempts, failures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from sqlalchemy import Connection, func, select

from workers.model import Json, RunState, TaskState
from workers.store import schema
from workers.store.base import Clock, StorePart
from workers.store.counters import AttemptCounters
from workers.store.database import Database
from workers.store.event_notifier import EventNotifier
from workers.store.job_transaction import ACTIVE, RUNNING, StorePolicy

_FAILURE_WINDOW_S = 900.0
_PACE_S = 300.0
_CHEAP_S, _SHARE = 0.05, 20


class CachedCounts:
    """Counts over the whole history, cached for twenty times the duration of the query, so that queries take at most a
    twentieth of the database's time. Thread-safe."""

    def __init__(self, count: Callable[[Connection], dict[str, int]]) -> None:
        self._count = count
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}
        self._good_until = 0.0

    def get(self, connection: Connection) -> dict[str, int]:
        with self._lock:
            began = time.monotonic()
            if began >= self._good_until:
                self._counts = self._count(connection)
                took = time.monotonic() - began
                self._good_until = began + (_SHARE * took if took > _CHEAP_S else 0.0)
            return dict(self._counts)


class Statistics(StorePart):
    """Read-only."""

    def __init__(
        self, db: Database, notifier: EventNotifier, policy: StorePolicy, now: Clock, counters: AttemptCounters
    ) -> None:
        super().__init__(db, notifier, policy, now)
        self._counters = counters
        self._jobs = CachedCounts(_jobs_by_state)
        self._tasks = CachedCounts(_tasks_by_state)

    def snapshot(self) -> Json:
        """Jobs and tasks by state, queue depth and age (s), attempts that run, failures by code (15 min), frames
        finished a second by method (5 min), webhook messages that wait; totals since this process began; and the
        time of all this."""
        with self._db.read() as connection:
            return {
                "at": self._now(),
                "jobs": self._jobs.get(connection),
                "tasks": self._tasks.get(connection),
                "queue": _queue(connection, self._now()),
                "attempts_running": _count(connection),
                "failures": _failures(connection, self._now() - _FAILURE_WINDOW_S),
                "frames_per_s": _frames_per_s(connection, self._now() - _PACE_S),
                "webhooks_waiting": _webhooks(connection),
                "totals": self._counters.counts(),
            }


def _jobs_by_state(connection: Connection) -> dict[str, int]:
    found = connection.execute(select(schema.jobs.c.state, func.count()).group_by(schema.jobs.c.state))
    return {state.value: 0 for state in RunState} | {state: int(n) for state, n in found}


def _tasks_by_state(connection: Connection) -> dict[str, int]:
    columns = [func.coalesce(func.sum(schema.steps.c[state.value]), 0) for state in TaskState]
    row = connection.execute(select(*columns)).one()
    return {state.value: int(n) for state, n in zip(TaskState, row, strict=True)}


def _queue(connection: Connection, now: float) -> Json:
    """Number of tasks that could run now, and the waiting time of the oldest queued job."""
    jobs, steps = schema.jobs, schema.steps
    current = (steps.c.job_id == jobs.c.id) & (steps.c.step == jobs.c.step)
    ready = select(func.coalesce(func.sum(steps.c.ready), 0)).join(jobs, current).where(jobs.c.state.in_(ACTIVE))
    oldest = select(func.min(jobs.c.created_at)).where(jobs.c.state == RunState.QUEUED.value)
    since = connection.execute(oldest).scalar()
    age = 0.0 if since is None else max(0.0, now - since)
    return {"ready_tasks": int(connection.execute(ready).scalar_one()), "oldest_s": age}


def _count(connection: Connection) -> int:
    attempts = schema.attempts
    return int(connection.execute(select(func.count()).where(attempts.c.outcome == RUNNING)).scalar_one())


def _failures(connection: Connection, since: float) -> dict[str, int]:
    """Failed attempts of the last quarter of an hour by the code of their fault."""
    attempts = schema.attempts
    query = select(attempts.c.fault).where(attempts.c.outcome == "failed", attempts.c.finished_at >= since).limit(1000)
    found: dict[str, int] = {}
    for fault in connection.execute(query).scalars():
        code = (fault or {}).get("code", "internal-error")
        found[code] = found.get(code, 0) + 1
    return found


def _frames_per_s(connection: Connection, since: float) -> dict[str, float]:
    jobs, tasks, attempts = schema.jobs, schema.tasks, schema.attempts
    query = (
        select(jobs.c.method, func.sum(tasks.c.emit_stop - tasks.c.emit_start))
        .join(tasks, tasks.c.job_id == jobs.c.id)
        .join(attempts, attempts.c.task_id == tasks.c.id)
        .where(attempts.c.outcome == "succeeded", attempts.c.finished_at >= since)
        .group_by(jobs.c.method)
    )
    return {method: float(frames or 0) / _PACE_S for method, frames in connection.execute(query)}


def _webhooks(connection: Connection) -> int:
    table = schema.deliveries
    return int(connection.execute(select(func.count()).where(table.c.state == "waiting")).scalar_one())
