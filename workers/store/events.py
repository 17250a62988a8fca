"""The history of jobs: lists numbered events, and waits for new ones. Read-only."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager

from sqlalchemy import Connection, func, select

from workers.contract.record import Event
from workers.errors import NotFound
from workers.store import schema
from workers.store.base import StorePart
from workers.store.records import event_of


class Events(StorePart):
    """Events by job. `seq` rises by one from 1; the oldest are pruned."""

    def list(self, job_id: str, after: int = 0, limit: int = 500) -> tuple[Sequence[Event], bool]:
        """Events with seq > `after`, and whether some of these have been pruned."""
        table = schema.events
        query = select(table).where(table.c.job_id == job_id, table.c.seq > after).order_by(table.c.seq).limit(limit)
        with self._db.read() as connection:
            newest = _newest_seq(connection, job_id)
            found = [event_of(row) for row in connection.execute(query).mappings()]
        first = found[0].seq if found else newest + 1
        return found, first > after + 1 and newest > after

    def wait(self, job_id: str, after: int, timeout_s: float) -> bool:
        """Block until the job has an event with seq > `after` (or is deleted: True as well); False on time-out."""
        if not self._notifier.newest(job_id):
            with self._db.read() as connection:
                self._notifier.notify(job_id, _newest_seq(connection, job_id))
        return self._notifier.wait(job_id, after, timeout_s, self._newest)

    def listening(self, job_id: str, on_news: Callable[[], None]) -> AbstractContextManager[None]:
        """Call `on_news`, in any thread, after each new event of the job, and its deletion, while the block runs."""
        return self._notifier.listening(job_id, on_news, self._newest)

    def _newest(self, job_ids: Collection[str]) -> dict[str, int]:
        jobs = schema.jobs
        with self._db.read() as connection:
            found = connection.execute(select(jobs.c.id, jobs.c.last_seq).where(jobs.c.id.in_(job_ids)))
            return {job_id: int(seq) for job_id, seq in found}


def _newest_seq(connection: Connection, job_id: str) -> int:
    query = select(func.max(schema.jobs.c.last_seq)).where(schema.jobs.c.id == job_id)
    seq = connection.execute(query).scalar()
    if seq is None:
        raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
    return int(seq)
