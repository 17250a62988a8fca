"""Tells those who wait for a job's events, of this process or of another. Waiting takes no thread.

Events of this process notify at once. For those of others, a thread queries the database for all awaited jobs, every
quarter of a second; less often, down to once a second, while it finds nothing new. (PostgreSQL's NOTIFY would be a
little faster, but it makes all commits queue at one lock, is lost on a fail-over, and does not pass through poolers.)
"""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager

from pipeline.errors import StorageError

log = logging.getLogger(__name__)

GONE = 1 << 62
"""Number of the newest event of a deleted job."""
_REMEMBERED = 4096
_POLL_INTERVAL_S = (0.25, 1.0)
_AWAY_S = 2.0
_IDLE_TIMEOUT_S = 5.0
"""Seconds for which the query thread runs without listeners before it ends."""

Newest = Callable[[Collection[str]], Mapping[str, int]]
"""Function: ids of jobs -> the number of the newest event of each existing one."""


class EventNotifier:
    """Knows the number of each job's newest event, and waits for the next one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest: OrderedDict[str, int] = OrderedDict()
        self._listeners: dict[str, list[Callable[[], None]]] = {}
        self._polling = False

    def notify(self, job_id: str, seq: int) -> None:
        """Record that the job has an event of this number."""
        with self._lock:
            self._newest[job_id] = max(seq, self._newest.get(job_id, 0))
            self._newest.move_to_end(job_id)
            while len(self._newest) > _REMEMBERED:
                self._newest.popitem(last=False)
            listeners = tuple(self._listeners.get(job_id, ()))
        for listener in listeners:
            listener()

    def newest(self, job_id: str) -> int:
        """The number of the job's newest event that is known here, 0 if none is."""
        with self._lock:
            return self._newest.get(job_id, 0)

    def wait(self, job_id: str, after: int, timeout_s: float, newest: Newest) -> bool:
        """Wait until the job is known to have an event with seq > `after`; False on time-out.

        Args:
            newest: queries the database for all jobs that are listened to.
        """
        news, end = threading.Event(), time.monotonic() + timeout_s
        with self.listening(job_id, news.set, newest):
            while self.newest(job_id) <= after and news.wait(max(0.0, end - time.monotonic())):
                news.clear()
        return self.newest(job_id) > after

    @contextmanager
    def listening(self, job_id: str, on_news: Callable[[], None], newest: Newest) -> Iterator[None]:
        """Call `on_news`, in any thread, after each event of the job that becomes known while the block runs."""
        with self._lock:
            self._listeners.setdefault(job_id, []).append(on_news)
            if not self._polling:
                self._polling = True
                threading.Thread(target=self._poll, args=(newest,), name="impasto-events", daemon=True).start()
        try:
            yield
        finally:
            with self._lock:
                self._listeners[job_id].remove(on_news)
                if not self._listeners[job_id]:
                    del self._listeners[job_id]

    def _poll(self, newest: Newest) -> None:
        """Query while there are listeners, and a little longer."""
        needed, (soon_s, late_s) = time.monotonic(), _POLL_INTERVAL_S
        pause_s = soon_s
        while True:
            time.sleep(pause_s)
            with self._lock:
                waited = list(self._listeners)
                needed = time.monotonic() if waited else needed
                if time.monotonic() - needed > _IDLE_TIMEOUT_S:
                    self._polling = False
                    return
            if waited:
                pause_s = soon_s if self._poll_once(waited, newest) else min(late_s, 1.2 * pause_s)

    def _poll_once(self, waited: list[str], newest: Newest) -> bool:
        """Poll once; whether any job had a new event."""
        try:
            found = newest(waited)
        except StorageError as error:
            log.warning("events of other processes wait: %s", error)
            time.sleep(_AWAY_S)
            return True
        except Exception:
            log.exception("querying events failed; it will be tried again")
            time.sleep(_AWAY_S)
            return True
        news = {job_id: seq for job_id in waited if (seq := found.get(job_id, GONE)) > self.newest(job_id)}
        for job_id, seq in news.items():
            self.notify(job_id, seq)
        return bool(news)
