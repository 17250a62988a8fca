"""What every part of the store shares: the database, the clock, the policy, and the bell that wakes who waits."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from workers.errors import NotFound
from workers.store.book import JobBook, Policy
from workers.store.database import Database

Clock = Callable[[], float]
_REMEMBERED = 4096


class Bell:
    """Rings when a job's history grows in this process: (job id, newest event)."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._newest: OrderedDict[str, int] = OrderedDict()

    def ring(self, job_id: str, seq: int) -> None:
        with self._changed:
            self._newest[job_id] = max(seq, self._newest.get(job_id, 0))
            self._newest.move_to_end(job_id)
            while len(self._newest) > _REMEMBERED:
                self._newest.popitem(last=False)
            self._changed.notify_all()

    def wait(self, job_id: str, after: int, timeout_s: float) -> bool:
        """Until the job is known to have an event with seq > `after`; False on time-out."""
        with self._changed:
            return self._changed.wait_for(lambda: self._newest.get(job_id, 0) > after, timeout_s)


class Base:
    """A part of the store."""

    def __init__(self, db: Database, bell: Bell, policy: Policy, now: Clock = time.time) -> None:
        self._db = db
        self._bell = bell
        self._policy = policy
        self._now = now

    @contextmanager
    def _book(self, job_id: str) -> Iterator[JobBook]:
        """The job under lock; committed at the end, and the bell rung. Raises NotFound."""
        with self._book_if_any(job_id) as book:
            if book is None:
                raise NotFound(f"There is no job {job_id}.", field="job", value=job_id)
            yield book

    @contextmanager
    def _book_if_any(self, job_id: str) -> Iterator[JobBook | None]:
        """Like `_book`; None if there is no such job."""
        with self._db.write() as connection:
            book = JobBook.open(connection, job_id, self._now(), self._policy)
            yield book
            if book is not None:
                book.close()
        if book is not None and book.changed:
            self._bell.ring(job_id, book.seq)
