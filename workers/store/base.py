"""Base class of the store's parts: database, clock, policy, event notifier."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from workers.errors import NotFound
from workers.store.database import Database
from workers.store.event_notifier import EventNotifier
from workers.store.job_transaction import JobTransaction, StorePolicy

Clock = Callable[[], float]


class StorePart:
    """A part of the store."""

    def __init__(self, db: Database, notifier: EventNotifier, policy: StorePolicy, now: Clock) -> None:
        self._db = db
        self._notifier = notifier
        self._policy = policy
        self._now = now

    @contextmanager
    def _transaction(self, job_id: str) -> Iterator[JobTransaction]:
        """The locked job; committed at the end, then its listeners are notified. Raises NotFound."""
        with self._transaction_if_any(job_id) as job:
            if job is None:
                raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
            yield job

    @contextmanager
    def _transaction_if_any(self, job_id: str) -> Iterator[JobTransaction | None]:
        """Like `_transaction`; None if there is no such job."""
        with self._db.write() as connection:
            job = JobTransaction.open(connection, job_id, self._now(), self._policy)
            yield job
            if job is not None:
                job.close()
        if job is not None and job.changed:
            self._notifier.notify(job_id, job.seq)
