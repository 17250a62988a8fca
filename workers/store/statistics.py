"""Statistics for operators: queue depth, running attempts, failures."""

from __future__ import annotations

from sqlalchemy import Connection, func, select

from workers.contract.record import RunState
from workers.contract.request import Json
from workers.store import schema, state_counts
from workers.store.base import Clock, StorePart
from workers.store.counters import AttemptCounters
from workers.store.database import Database
from workers.store.event_notifier import EventNotifier
from workers.store.job_transaction import RUNNING, StorePolicy

_FAILURE_WINDOW_S = 900.0
_PACE_S = 300.0


class Statistics(StorePart):
    """Read-only."""

    def __init__(
        self, db: Database, notifier: EventNotifier, policy: StorePolicy, now: Clock, counters: AttemptCounters
    ) -> None:
        super().__init__(db, notifier, policy, now)
        self._counters = counters

    def jobs_by_state(self) -> dict[str, int]:
        """Number of jobs by state."""
        with self._db.read() as connection:
            return state_counts.jobs_by_state(state_counts.read(connection))

    def snapshot(self) -> Json:
        """Jobs and tasks by state, queue depth and age (s), attempts that run, failures by code (15 min), frames
        finished a second by method (5 min), webhook messages that wait; totals since this process began; and the
        time of all this."""
        with self._db.read() as connection:
            counts = state_counts.read(connection)
            return {
                "at": self._now(),
                "jobs": state_counts.jobs_by_state(counts),
                "tasks": state_counts.tasks_by_state(counts),
                "queue": {"ready_tasks": counts["startable"], "oldest_s": _oldest_s(connection, self._now())},
                "attempts_running": _count(connection),
                "failures": _failures(connection, self._now() - _FAILURE_WINDOW_S),
                "frames_per_s": _frames_per_s(connection, self._now() - _PACE_S),
                "webhooks_waiting": _webhooks(connection),
                "totals": self._counters.counts(),
            }


def _oldest_s(connection: Connection, now: float) -> float:
    """Waiting time of the oldest queued job, seconds."""
    jobs = schema.jobs
    oldest = select(jobs.c.created_at).where(jobs.c.state == RunState.QUEUED.value).order_by(jobs.c.id).limit(1)
    since = connection.execute(oldest).scalar()
    return 0.0 if since is None else max(0.0, now - since)


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
